#include "reply/checked_lists.h"

#include <utility>
#include <vector>

#include "reply/list_check.h"

namespace voxelpipe {

absl::Status CheckedLists::Begin(const ResultHeader& header) {
  header_ = header;
  lists_ = header.arrays.size() - header.specs.size();
  ResultHeader lists = header;
  lists.specs.clear();
  lists.arrays.resize(lists_);
  if (absl::Status s = held_.Begin(lists); !s.ok()) return s;
  return next_.Begin(header);
}

absl::Status CheckedLists::Write(size_t array, std::span<const uint8_t> bytes) {
  if (array < lists_) return held_.Write(array, bytes);
  if (absl::Status s = Finish(); !s.ok()) return s;
  return next_.Write(array, bytes);
}

absl::Status CheckedLists::Finish() {
  if (std::exchange(forwarded_, true)) return absl::OkStatus();
  VoxelizeResult lists = held_.Take();
  lists.specs = header_.specs;
  if (absl::Status s = CheckLists(lists, header_.arrays); !s.ok()) return s;
  const std::vector<std::span<const uint8_t>> arrays = ArraysOf(lists);
  for (size_t i = 0; i < arrays.size(); ++i) {
    if (arrays[i].empty()) continue;
    if (absl::Status s = next_.Write(i, arrays[i]); !s.ok()) return s;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
