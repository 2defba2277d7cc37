#include "calls/result_pieces.h"

#include <algorithm>

#include "base/crc32c.h"
#include "wire/response.h"
#include "wire/text.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxWarnings = 32;
constexpr size_t kMaxWarningBytes = 300;

}  // namespace

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
  *summary->mutable_mesh() = ToMessage(outcome.report, outcome.examined);
  for (size_t i = 0; i < std::min(kMaxWarnings, outcome.warnings.size()); ++i) {
    summary->mutable_mesh()->add_warnings(CleanText(outcome.warnings[i], kMaxWarningBytes));
  }
  summary->set_peak_bytes(outcome.peak_bytes);
  summary->set_content_sha256(hash_.HexDigest());
}

}  // namespace voxelpipe
