#include "calls/result_stream.h"

#include <algorithm>
#include <span>
#include <vector>

#include "service_state.h"

namespace voxelpipe {

bool ResultStream::Next(v1::VoxelizeResponse& response) {
  if (part_ == Part::kHeader) {
    ResultPieces::MakeHeader(HeaderOf(outcome_.result), response);
    part_ = Part::kPieces;
    return true;
  }
  if (part_ == Part::kPieces) {
    if (NextPiece(response)) return true;
    part_ = Part::kSummary;
  }
  if (part_ == Part::kEnd) return false;
  pieces_.MakeSummary(outcome_, response);
  part_ = Part::kEnd;
  return true;
}

bool ResultStream::NextPiece(v1::VoxelizeResponse& response) {
  const std::vector<HostBuffer*> arrays = MutableArraysOf(outcome_.result);
  while (array_ < arrays.size() && offset_ == arrays[array_]->size()) {
    *arrays[array_] = HostBuffer();  // sent: make room
    ++array_;
    offset_ = 0;
  }
  if (array_ == arrays.size()) return false;
  const std::span<const uint8_t> all = arrays[array_]->bytes();
  const std::span<const uint8_t> data = all.subspan(offset_, std::min(kPieceBytes, all.size() - offset_));
  pieces_.MakePiece(array_, data, response);
  offset_ += data.size();
  return true;
}

}  // namespace voxelpipe
