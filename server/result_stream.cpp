#include "result_stream.h"

#include <algorithm>

#include "base/crc32c.h"
#include "service_state.h"
#include "wire/response.h"
#include "wire/text.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxWarnings = 32;
constexpr size_t kMaxWarningBytes = 300;

}  // namespace

bool ResultStream::Next(v1::VoxelizeResponse& response) {
  response.Clear();
  if (part_ == Part::kHeader) {
    const VoxelizeResult& result = outcome_.result;
    *response.mutable_header() = MakeHeader(result.grid, result.layout, result.specs);
    part_ = Part::kPieces;
    return true;
  }
  if (part_ == Part::kPieces) {
    if (NextPiece(response)) return true;
    part_ = Part::kSummary;
  }
  if (part_ == Part::kEnd) return false;
  MakeSummary(response);
  part_ = Part::kEnd;
  return true;
}

bool ResultStream::NextPiece(v1::VoxelizeResponse& response) {
  std::vector<HostBuffer>& targets = outcome_.result.targets;
  while (target_ < targets.size() && offset_ == targets[target_].size()) {
    targets[target_] = HostBuffer();  // sent: make room
    ++target_;
    offset_ = 0;
  }
  if (target_ == targets.size()) return false;
  const std::span<const uint8_t> all = targets[target_].bytes();
  const std::span<const uint8_t> data = all.subspan(offset_, std::min(kPieceBytes, all.size() - offset_));
  hash_.Update(data);
  v1::ResultPiece* piece = response.mutable_piece();
  piece->set_target(uint32_t(target_));
  piece->set_offset(offset_);
  piece->set_data(data.data(), data.size());
  piece->set_crc32c(Crc32c(data));
  offset_ += data.size();
  bytes_sent_ += data.size();
  return true;
}

void ResultStream::MakeSummary(v1::VoxelizeResponse& response) {
  v1::Summary* summary = response.mutable_summary();
  *summary->mutable_stats() = ToMessage(outcome_.result.stats);
  *summary->mutable_mesh() = ToMessage(outcome_.report, outcome_.examined);
  for (size_t i = 0; i < std::min(kMaxWarnings, outcome_.warnings.size()); ++i) {
    summary->mutable_mesh()->add_warnings(CleanText(outcome_.warnings[i], kMaxWarningBytes));
  }
  summary->set_peak_bytes(outcome_.peak_bytes);
  summary->set_content_sha256(hash_.HexDigest());
}

}  // namespace voxelpipe
