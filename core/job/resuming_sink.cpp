#include "job/resuming_sink.h"

#include <algorithm>
#include <utility>

namespace voxelpipe {

bool ResumingSink::Keep(VoxelizeResult&& whole) {
  return !begun() && out_->Keep(std::move(whole));
}

absl::Status ResumingSink::Begin(const ResultHeader& header) {
  made_ = {};
  if (!header_) {
    header_ = header;
    return out_->Begin(header);
  }
  const bool same = header.kind == header_->kind && header.grid == header_->grid && header.layout == header_->layout &&
                    header.arrays == header_->arrays;
  return same ? absl::OkStatus() : absl::InternalError("the repeated run has another header than the first");
}

absl::Status ResumingSink::Write(size_t array, std::span<const uint8_t> bytes) {
  if (array != made_.array) made_ = {array, 0};
  const uint64_t begin = made_.offset;
  made_.offset += bytes.size();
  if (array < delivered_.array) return absl::OkStatus();
  if (array == delivered_.array) {
    const uint64_t known = delivered_.offset > begin ? delivered_.offset - begin : 0;
    bytes = bytes.subspan(std::min<uint64_t>(known, bytes.size()));
    if (bytes.empty()) return absl::OkStatus();
  }
  // Counted before the write: bytes that a failed write may have taken are not sent again, and its failure ends the
  // job.
  delivered_ = made_;
  return out_->Write(array, bytes);
}

}  // namespace voxelpipe
