#include "reply/result_pieces.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <google/protobuf/arena.h>

#include "base/checksum/crc32c.h"
#include "wire/duration.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

// The size of the messages of a small result, without the result.
constexpr size_t kArenaBytes = 4096;

}  // namespace

bool FitsOneMessage(uint64_t result_bytes, const CallSettings& settings) {
  const int64_t limit =
      std::min(settings.single_message_bytes.value_or(kMaxSingleMessageBytes), kMaxSingleMessageBytes);
  return limit > 0 && result_bytes <= uint64_t(limit);
}

ResultPieces::ResultPieces(const VoxelizeRequest& request, const CallSettings& settings, const PieceOptions& options,
                           ResponseCoder coder)
    : request_(request), options_(options), hashed_(settings.content_hash), coder_(coder) {
  if (settings.compression == Compression::kZstd) compressor_.emplace(options.zstd_level);
}

grpc::ByteBuffer ResultPieces::Header(const ResultHeader& header, const Plan* plan) const {
  v1::VoxelizeResponse response;
  if (plan != nullptr) WriteTo(*plan, *response.mutable_plan());
  WriteTo(header, request_, *response.mutable_header());
  return coder_.Message(response);
}

CodedPiece ResultPieces::Code(size_t array, std::span<const uint8_t> bytes, std::shared_ptr<const void> owner) {
  if (array != std::exchange(array_, array)) offset_ = 0;
  CodedPiece piece;
  piece.array = uint32_t(array);
  piece.offset = std::exchange(offset_, offset_ + bytes.size());
  piece.data = bytes;
  piece.owner = std::move(owner);
  std::optional<std::vector<uint8_t>> frame;
  if (compressor_) frame = compressor_->Compress(bytes);
  const bool compressed = frame.has_value();
  if (compressed) {
    piece.uncompressed_bytes = bytes.size();
    auto kept = std::make_shared<const std::vector<uint8_t>>(*std::move(frame));
    piece.data = *kept;
    piece.owner = std::move(kept);
  } else if (piece.owner == nullptr) {
    auto kept = std::make_shared<const std::vector<uint8_t>>(bytes.begin(), bytes.end());
    piece.data = *kept;
    piece.owner = std::move(kept);
  }
  piece.crc32c = sums_ && !compressed ? sums_->Crc32cOf(array, piece.offset, piece.data) : Crc32c(piece.data);
  bytes_ += bytes.size();
  sent_bytes_ += piece.data.size();
  return piece;
}

grpc::ByteBuffer ResultPieces::Piece(size_t array, std::span<const uint8_t> bytes, std::shared_ptr<const void> owner) {
  return coder_.Piece(Code(array, bytes, std::move(owner)));
}

void ResultPieces::Hash(std::span<const uint8_t> bytes) {
  if (!hashed_ || !known_hash_.empty()) return;
  if (!hash_) hash_.emplace();
  hash_->Update(bytes);
}

void ResultPieces::SetShared(bool cached, std::shared_ptr<ResultSums> sums) {
  cached_ = cached;
  sums_ = std::move(sums);
  if (hashed_ && sums_) known_hash_ = sums_->sha256();
}

void WriteOutcome(const JobOutcome& outcome, v1::Summary& summary) {
  v1::VoxelizeStats& stats = *summary.mutable_stats();
  WriteTo(outcome.result.stats, stats);
  stats.set_worker(outcome.worker);
  WriteMs(outcome.queue_ms, *stats.mutable_queue_time());
  stats.set_batch_jobs(int32_t(outcome.batch_jobs));
  if (outcome.batch_launches) stats.set_batch_launches(int64_t(*outcome.batch_launches));
  stats.set_attempts(int32_t(outcome.attempts));
  WriteTo(outcome.report, outcome.examined, *summary.mutable_report());
  WriteWarnings(outcome.result.stats.warnings, summary);
  summary.set_peak_bytes(int64_t(outcome.peak_bytes));
}

void ResultPieces::MakeSummary(const JobOutcome& outcome, v1::Summary& summary) {
  WriteOutcome(outcome, summary);
  if (hashed_ && !known_hash_.empty()) {
    summary.set_content_sha256(known_hash_);
  } else if (hashed_) {
    if (!hash_) hash_.emplace();
    known_hash_ = hash_->HexDigest();
    if (sums_) sums_->SetSha256(known_hash_);
    summary.set_content_sha256(known_hash_);
  }
  summary.set_result_bytes(int64_t(bytes_));
  summary.set_sent_bytes(int64_t(sent_bytes_));
  summary.set_cached(cached_);
}

grpc::ByteBuffer ResultPieces::Summary(const JobOutcome& outcome) {
  v1::VoxelizeResponse response;
  MakeSummary(outcome, *response.mutable_summary());
  return coder_.Message(response);
}

grpc::ByteBuffer ResultPieces::Whole(const Plan* plan, const std::shared_ptr<const JobOutcome>& outcome) {
  // An arena: otherwise about forty small parts would be allocated and freed one by one.
  alignas(std::max_align_t) char room[kArenaBytes];
  google::protobuf::Arena arena(room, sizeof room);
  auto& head = *google::protobuf::Arena::CreateMessage<v1::VoxelizeResponse>(&arena);
  if (plan != nullptr) WriteTo(*plan, *head.mutable_plan());
  WriteTo(HeaderOf(outcome->result), request_, *head.mutable_header());
  std::vector<CodedPiece> pieces;
  const std::vector<std::span<const uint8_t>> arrays = ArraysOf(outcome->result);
  for (size_t i = 0; i < arrays.size(); ++i) {
    if (arrays[i].empty()) continue;
    pieces.push_back(Code(i, arrays[i], outcome));
    Hash(arrays[i]);
  }
  MakeSummary(*outcome, *head.mutable_summary());
  return coder_.Whole(head, pieces);
}

uint64_t ResultBytes(const VoxelizeResult& result) {
  uint64_t bytes = 0;
  for (const std::span<const uint8_t> array : ArraysOf(result)) bytes += array.size();
  return bytes;
}

}  // namespace voxelpipe
