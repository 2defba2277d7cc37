#include "result_reader.h"

#include <openssl/evp.h>

#include <algorithm>
#include <string>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "base/crc32c.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

template <typename... Parts>
absl::Status Lost(const Parts&... parts) {
  return absl::DataLossError(absl::StrCat("the server's result: ", parts...));
}

// The grid that the server says it chose, held against what was asked for. Its size on the mesh is the server's to say
// only where the request leaves it open (voxel_size alone).
absl::Status CheckGrid(const GridSpec& grid, const GridRequest& request) {
  const double padding = 2.0 * double(request.padding);
  for (size_t axis = 0; axis < 3; ++axis) {
    const double n = double(grid.dims[axis]);
    if (request.dims && n != double((*request.dims)[axis]) + padding) {
      return Lost("dims[", axis, "] is ", grid.dims[axis], ", asked for were ", (*request.dims)[axis], " and padding ",
                  request.padding);
    }
    if (!request.dims && !request.voxel_size && n > double(request.resolution) + padding) {
      return Lost("dims[", axis, "] is ", grid.dims[axis], ", asked for was resolution ", request.resolution,
                  " and padding ", request.padding);
    }
  }
  if (request.voxel_size && !(grid.voxel_size == *request.voxel_size))
    return Lost("its voxel size is not the one asked for");
  return absl::OkStatus();
}

}  // namespace

void ResultReader::FreeDigest::operator()(evp_md_ctx_st* context) const {
  EVP_MD_CTX_free(context);
}

ResultReader::ResultReader(const VoxelizeRequest& request, uint64_t max_result_bytes)
    : request_(request), max_result_bytes_(max_result_bytes), digest_(EVP_MD_CTX_new()) {}

ResultReader::~ResultReader() = default;

absl::Status ResultReader::AddHeader(const v1::ResultHeader& header) {
  if (has_header_) return Lost("a second header");
  if (!digest_ || EVP_DigestInit_ex(digest_.get(), EVP_sha256(), nullptr) != 1) {
    return absl::InternalError("SHA-256 could not be started");
  }
  absl::StatusOr<GridSpec> grid = CheckHeader(header, request_.layout, request_.targets);
  if (!grid.ok()) return grid.status();
  if (absl::Status status = CheckGrid(*grid, request_.grid); !status.ok()) return status;
  for (const TargetSpec& spec : request_.targets) total_bytes_ += TargetBytes(spec, grid->voxels());
  if (total_bytes_ > max_result_bytes_) {
    return Lost(total_bytes_, " bytes are announced, this client takes ", max_result_bytes_);
  }
  out_.result.grid = *grid;
  out_.result.layout = request_.layout;
  out_.result.specs = request_.targets;
  for (const TargetSpec& spec : request_.targets) {
    absl::StatusOr<HostBuffer> buffer = HostBuffer::Allocate(TargetBytes(spec, grid->voxels()));
    if (!buffer.ok()) return buffer.status();
    out_.result.targets.push_back(*std::move(buffer));
  }
  has_header_ = true;
  return absl::OkStatus();
}

absl::Status ResultReader::AddPiece(const v1::ResultPiece& piece) {
  if (!has_header_) return Lost("a piece before the header");
  if (has_summary_) return Lost("a piece after the summary");
  if (piece.data().empty()) return Lost("a piece without bytes");
  if (target_ < out_.result.targets.size() && offset_ == out_.result.targets[target_].size()) {
    ++target_;
    offset_ = 0;
  }
  if (target_ == out_.result.targets.size()) return Lost("more bytes than announced");
  if (piece.target() != target_ || piece.offset() != offset_) {
    return Lost("a piece of target ", piece.target(), " at offset ", piece.offset(), ", expected was target ", target_,
                " at ", offset_);
  }
  HostBuffer& buffer = out_.result.targets[target_];
  const std::string& data = piece.data();
  if (data.size() > buffer.size() - offset_) {
    return Lost("a piece of ", data.size(), " bytes at offset ", offset_, " of target ", target_, ", which has ",
                buffer.size());
  }
  uint8_t* place = buffer.data() + offset_;
  std::copy_n(reinterpret_cast<const uint8_t*>(data.data()), data.size(), place);
  if (Crc32c({place, data.size()}) != piece.crc32c()) {
    return Lost("the CRC32C of the piece at offset ", offset_, " of target ", target_, " does not match its bytes");
  }
  if (EVP_DigestUpdate(digest_.get(), place, data.size()) != 1) return absl::InternalError("SHA-256 failed");
  offset_ += data.size();
  received_bytes_ += data.size();
  return absl::OkStatus();
}

absl::Status ResultReader::AddSummary(const v1::Summary& summary) {
  if (!has_header_) return Lost("a summary before the header");
  if (has_summary_) return Lost("a second summary");
  if (received_bytes_ != total_bytes_) return Lost(received_bytes_, " of ", total_bytes_, " bytes came");
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int length = 0;
  if (EVP_DigestFinal_ex(digest_.get(), digest, &length) != 1) return absl::InternalError("SHA-256 failed");
  const std::string hex = absl::BytesToHexString(absl::string_view(reinterpret_cast<const char*>(digest), length));
  if (hex != summary.content_sha256()) {
    return Lost("its SHA-256 is ", hex, ", the server announced '", absl::CHexEscape(summary.content_sha256()), "'");
  }
  out_.content_sha256 = hex;
  out_.peak_bytes = summary.peak_bytes();
  out_.report = FromMessage(summary.mesh());
  VoxelizeStats stats = FromMessage(summary.stats());
  // The server lists what it did with the file among its stages; here as in-process they stand apart.
  const auto is_mesh_stage = [](const std::pair<std::string, double>& stage) {
    return stage.first == "load" || stage.first == "flatten";
  };
  for (const auto& stage : stats.stages) {
    if (is_mesh_stage(stage)) out_.mesh_stages.push_back(stage);
  }
  stats.stages.erase(std::remove_if(stats.stages.begin(), stats.stages.end(), is_mesh_stage), stats.stages.end());
  out_.result.stats = std::move(stats);
  has_summary_ = true;
  return absl::OkStatus();
}

absl::StatusOr<RemoteResult> ResultReader::Take() {
  if (!has_summary_) return Lost("it ended before its summary");
  return std::move(out_);
}

}  // namespace voxelpipe
