#include "engine/hash.h"

namespace voxelpipe::cli {

absl::Status HashingSink::Begin(const ResultHeader& header) {
  header_ = header;
  return next_ != nullptr ? next_->Begin(header) : absl::OkStatus();
}

absl::Status HashingSink::Write(size_t array, std::span<const uint8_t> bytes) {
  bytes_ += bytes.size();
  hash_.Update(bytes);
  return next_ != nullptr ? next_->Write(array, bytes) : absl::OkStatus();
}

}  // namespace voxelpipe::cli
