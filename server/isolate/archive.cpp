#include "isolate/archive.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

// Below this size waking another thread takes longer than copying.
constexpr uint64_t kMinParallelBytes = 2 << 20;
constexpr uint64_t kCopyBytes = 1 << 20;

}  // namespace

void ArchiveWriter::CopyBulk(uint8_t* to) const {
  std::vector<Bulk> pieces;
  for (Bulk bulk : bulk_) {
    while (bulk.bytes > 0) {
      const uint64_t bytes = std::min(bulk.bytes, kCopyBytes);
      pieces.push_back({bulk.data, bytes, bulk.offset});
      bulk = {bulk.data + bytes, bulk.bytes - bytes, bulk.offset + bytes};
    }
  }
  const auto copy = [&](size_t i) { std::memcpy(to + pieces[i].offset, pieces[i].data, pieces[i].bytes); };
  if (bulk_bytes_ >= kMinParallelBytes) {
    tbb::parallel_for(size_t{0}, pieces.size(), copy);
  } else {
    for (size_t i = 0; i < pieces.size(); ++i) copy(i);
  }
}

absl::Status ArchiveReader::Finish() {
  if (ok() && !text_.empty()) Refuse("bytes are left over");
  if (!ok())
    return absl::InternalError(absl::StrCat("the answer of a process that loads meshes is malformed: ", fault_));
  if (bulk_used_ >= kMinParallelBytes) {
    tbb::parallel_for(size_t{0}, copies_.size(), [this](size_t i) { copies_[i](); });
  } else {
    for (const auto& copy : copies_) copy();
  }
  copies_.clear();
  return absl::OkStatus();
}

}  // namespace voxelpipe
