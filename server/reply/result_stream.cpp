#include "reply/result_stream.h"

#include <algorithm>
#include <utility>

namespace voxelpipe {

ResultStream::ResultStream(std::shared_ptr<const JobOutcome> outcome, const VoxelizeRequest& request,
                           const CallSettings& settings, const PieceOptions& options, ResponseCoder coder, bool cached)
    : outcome_(std::move(outcome)), arrays_(ArraysOf(outcome_->result)), pieces_(request, settings, options, coder) {
  pieces_.SetShared(cached, outcome_->sums);
}

grpc::ByteBuffer ResultStream::Next() {
  if (part_ == Part::kHeader) {
    part_ = Part::kPieces;
    return pieces_.Header(HeaderOf(outcome_->result), plan_ ? &*plan_ : nullptr);
  }
  while (array_ < arrays_.size() && offset_ == arrays_[array_].size()) {
    ++array_;
    offset_ = 0;
  }
  if (array_ == arrays_.size()) {
    part_ = Part::kEnd;
    return pieces_.Summary(*outcome_);
  }
  const std::span<const uint8_t> all = arrays_[array_];
  to_hash_ = all.subspan(offset_, std::min(pieces_.piece_bytes(), all.size() - offset_));
  offset_ += to_hash_.size();
  return pieces_.Piece(array_, to_hash_, outcome_);
}

void ResultStream::CatchUp() {
  if (!to_hash_.empty()) pieces_.Hash(std::exchange(to_hash_, {}));
}

}  // namespace voxelpipe
