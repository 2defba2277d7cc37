#include "calls/result_pieces.h"

#include "base/crc32c.h"
#include "wire/response.h"

namespace voxelpipe {

void ResultPieces::MakeHeader(const ResultHeader& header, v1::VoxelizeResponse& response) {
  response.Clear();
  *response.mutable_header() = ToMessage(header);
}

void ResultPieces::MakePiece(size_t array, std::span<const uint8_t> bytes, v1::VoxelizeResponse& response) {
  response.Clear();
  if (array != array_) {
    array_ = array;
    offset_ = 0;
  }
  hash_.Update(bytes);
  v1::ResultPiece* piece = response.mutable_piece();
  piece->set_target(uint32_t(array));
  piece->set_offset(offset_);
  piece->set_data(bytes.data(), bytes.size());
  piece->set_crc32c(Crc32c(bytes));
  offset_ += bytes.size();
  bytes_ += bytes.size();
}

void ResultPieces::MakeSummary(const JobOutcome& outcome, v1::VoxelizeResponse& response) {
  response.Clear();
  v1::Summary* summary = response.mutable_summary();
  *summary->mutable_stats() = ToMessage(outcome.result.stats);
  *summary->mutable_mesh() = ToMessage(outcome.report, outcome.examined, outcome.warnings);
  summary->set_peak_bytes(outcome.peak_bytes);
  summary->set_content_sha256(hash_.HexDigest());
}

}  // namespace voxelpipe
