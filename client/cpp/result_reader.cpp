#include "result_reader.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <grpcpp/impl/codegen/proto_utils.h>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "reply/zstd_frame.h"
#include "wire/count.h"
#include "wire/duration.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

// The maximum of one compressed piece of a server.
constexpr int64_t kMaxFrameBytes = 64 << 20;

template <typename... Parts>
absl::Status Lost(const Parts&... parts) {
  return absl::DataLossError(absl::StrCat("the server's result: ", parts...));
}

// Checks the server's grid against the request. The server chooses the dims only if the request leaves them open
// (voxel_size alone).
absl::Status CheckGrid(const GridSpec& grid, const GridRequest& request) {
  const double padding = 2.0 * double(request.padding);
  for (size_t axis = 0; axis < 3; ++axis) {
    const double n = double(grid.dims[axis]);
    if (request.dims && n != double((*request.dims)[axis]) + padding) {
      return Lost("dims[", axis, "] is ", grid.dims[axis], ", requested were ", (*request.dims)[axis], " and padding ",
                  request.padding);
    }
    if (!request.dims && !request.voxel_size && n > double(request.resolution) + padding) {
      return Lost("dims[", axis, "] is ", grid.dims[axis], ", requested was resolution ", request.resolution,
                  " and padding ", request.padding);
    }
  }
  if (request.voxel_size && !(grid.voxel_size == *request.voxel_size))
    return Lost("its voxel size is not the requested one");
  return absl::OkStatus();
}

}  // namespace

ResultReader::ResultReader(const VoxelizeRequest& request, uint64_t max_result_bytes, ResultSink& sink, bool hashed,
                           ReaderEvents events)
    : request_(request), max_result_bytes_(max_result_bytes), sink_(sink), events_(std::move(events)) {
  if (hashed) hash_.emplace();
}

ResultReader::~ResultReader() = default;

absl::Status ResultReader::Add(grpc::ByteBuffer& buffer) {
  if (const std::span<const PieceView> pieces = viewer_.View(buffer); !pieces.empty()) return AddPieces(pieces);
  v1::VoxelizeResponse message;
  if (!grpc::SerializationTraits<v1::VoxelizeResponse>::Deserialize(&buffer, &message).ok()) {
    return Lost("a message that cannot be read");
  }
  return Add(message);
}

// Any parts may come together, in the order of their fields. A message without any is that of a newer server.
absl::Status ResultReader::Add(const v1::VoxelizeResponse& message) {
  absl::Status s = absl::OkStatus();
  if (message.has_plan()) s = AddPlan(message.plan());
  if (s.ok() && message.has_progress()) s = AddProgress(message.progress());
  if (s.ok() && message.has_header()) s = AddHeader(message.header());
  if (s.ok() && message.pieces_size() > 0) {
    std::vector<PieceView> pieces;
    for (const v1::ResultPiece& piece : message.pieces()) pieces.emplace_back(piece);
    s = AddPieces(pieces);
  }
  return s.ok() && message.has_summary() ? AddSummary(message.summary()) : s;
}

absl::Status ResultReader::AddPlan(const v1::VoxelizationPlan& message) {
  if (std::exchange(has_plan_, true)) return Lost("a second plan");
  if (has_header_) return Lost("a plan after the header");
  const absl::StatusOr<Plan> plan = FromMessage(message);
  if (!plan.ok()) return plan.status();
  if (events_.on_plan) events_.on_plan(*plan);
  return absl::OkStatus();
}

absl::Status ResultReader::AddProgress(const v1::Progress& message) {
  if (has_summary_) return Lost("progress after the summary");
  if (std::isnan(message.fraction())) return Lost("a progress that is no number");
  if (events_.on_progress) events_.on_progress(message.stage(), message.fraction());
  return absl::OkStatus();
}

absl::Status ResultReader::AddHeader(const v1::ResultHeader& message) {
  if (has_header_) return Lost("a second header");
  const absl::StatusOr<ResultHeader> header = FromMessage(message, request_);
  if (!header.ok()) return header.status();
  if (absl::Status status = CheckGrid(header->grid, request_.grid); !status.ok()) return status;
  for (const ArraySpec& array : header->arrays) {
    array_bytes_.push_back(array.bytes());  // below 2^60 each: FromMessage bounds every count
    total_bytes_ += array_bytes_.back();
  }
  if (total_bytes_ > max_result_bytes_) {
    return Lost(total_bytes_, " bytes are announced, this client takes ", max_result_bytes_);
  }
  has_header_ = true;
  return sink_.Begin(*header);
}

absl::Status ResultReader::AddPieces(std::span<const PieceView> pieces) {
  for (const PieceView& piece : pieces) {
    if (absl::Status s = AddPiece(piece); !s.ok()) return s;
  }
  ReportDownload();
  return absl::OkStatus();
}

absl::Status ResultReader::AddPiece(const PieceView& piece) {
  if (!has_header_) return Lost("a piece before the header");
  if (has_summary_) return Lost("a piece after the summary");
  const uint64_t data_bytes = piece.data_bytes();
  if (data_bytes == 0) return Lost("a piece without bytes");
  while (array_ < array_bytes_.size() && offset_ == array_bytes_[array_]) {
    ++array_;
    offset_ = 0;
  }
  if (array_ == array_bytes_.size()) return Lost("more bytes than announced");
  // What is expected is never negative.
  if (int64_t(piece.array) != int64_t(array_) || piece.offset != int64_t(offset_)) {
    return Lost("a piece of array ", piece.array, " at offset ", piece.offset, ", expected was array ", array_, " at ",
                offset_);
  }
  const bool frame = piece.uncompressed_bytes.has_value();
  const int64_t bytes = piece.uncompressed_bytes.value_or(int64_t(data_bytes));
  if (bytes < 1 || uint64_t(bytes) > array_bytes_[array_] - offset_ || (frame && bytes > kMaxFrameBytes)) {
    return Lost("a piece of ", bytes, " bytes at offset ", offset_, " of array ", array_, ", which has ",
                array_bytes_[array_]);
  }
  // Checks the whole piece before forwarding any of it: a piece stays in the CPU's cache meanwhile.
  if (piece.DataCrc32c() != piece.crc32c) {
    return Lost("the CRC32C of the piece at offset ", offset_, " of array ", array_, " does not match its bytes");
  }
  out_.sent_bytes += data_bytes;
  if (frame) return AddFrame(piece);
  for (const std::span<const uint8_t> part : piece.data) {
    if (absl::Status s = AddBytes(part); !s.ok()) return s;
  }
  return absl::OkStatus();
}

absl::Status ResultReader::AddFrame(const PieceView& piece) {
  std::vector<uint8_t> joined;
  std::span<const uint8_t> frame = piece.data.front();
  if (piece.data.size() > 1) {
    joined.reserve(piece.data_bytes());
    for (const std::span<const uint8_t> part : piece.data) joined.insert(joined.end(), part.begin(), part.end());
    frame = joined;
  }
  if (absl::Status s = DecompressFrame(frame, uint64_t(*piece.uncompressed_bytes), raw_); !s.ok()) return s;
  return AddBytes(raw_);
}

absl::Status ResultReader::AddBytes(std::span<const uint8_t> bytes) {
  if (hash_) hash_->Update(bytes);
  offset_ += bytes.size();
  received_bytes_ += bytes.size();
  return sink_.Write(array_, bytes);
}

absl::Status ResultReader::AddSummary(const v1::Summary& summary) {
  if (!has_header_) return Lost("a summary before the header");
  if (has_summary_) return Lost("a second summary");
  if (received_bytes_ != total_bytes_) return Lost(received_bytes_, " of ", total_bytes_, " bytes came");
  if (hash_) {
    if (absl::Status s = CheckHash(summary.content_sha256()); !s.ok()) return s;
  }
  out_.peak_bytes = CountOf(summary.peak_bytes());
  out_.cached = summary.cached();
  out_.report = FromMessage(summary.report());
  out_.served = {summary.stats().worker(), MsOf(summary.stats().queue_time()),
                 uint32_t(CountOf(summary.stats().batch_jobs())), std::nullopt,
                 uint32_t(CountOf(summary.stats().attempts()))};
  if (summary.stats().has_batch_launches()) out_.served.batch_launches = CountOf(summary.stats().batch_launches());
  VoxelizeStats stats = FromMessage(summary.stats());
  // The server reports load and flatten among its stages; here, as in-process, they are separate.
  const auto is_mesh_stage = [](const std::pair<std::string, double>& stage) {
    return stage.first == "load" || stage.first == "flatten";
  };
  for (const auto& stage : stats.stages) {
    if (is_mesh_stage(stage)) out_.mesh_stages.push_back(stage);
  }
  stats.stages.erase(std::remove_if(stats.stages.begin(), stats.stages.end(), is_mesh_stage), stats.stages.end());
  stats.warnings = ReadWarnings(summary);
  out_.stats = std::move(stats);
  has_summary_ = true;
  return absl::OkStatus();
}

absl::Status ResultReader::CheckHash(const std::string& announced) {
  const std::string hex = hash_->HexDigest();
  if (hex != announced) {
    return Lost("its SHA-256 is ", hex, ", the server announced '", absl::CHexEscape(announced), "'");
  }
  out_.content_sha256 = hex;
  return absl::OkStatus();
}

void ResultReader::ReportDownload() const {
  if (events_.on_progress) events_.on_progress("download", double(received_bytes_) / double(total_bytes_));
}

absl::StatusOr<RemoteRun> ResultReader::Take() {
  if (!has_summary_) return Lost("it ended before its summary");
  return std::move(out_);
}

}  // namespace voxelpipe
