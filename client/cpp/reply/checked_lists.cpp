#include "reply/checked_lists.h"

#include <utility>
#include <vector>

#include "reply/list_check.h"

namespace voxelpipe {

absl::Status CheckedLists::Begin(const ResultHeader& header) {
  header_ = header;
  ResultHeader lists = header;
  lists.specs.clear();
  lists.arrays.resize(header.lists());
  if (absl::Status s = held_.Begin(lists); !s.ok()) return s;
  parts_.Begin(header);
  return next_.Begin(header);
}

absl::Status CheckedLists::Write(size_t array, std::span<const uint8_t> bytes) {
  if (array < header_.lists()) return held_.Write(array, bytes);
  if (absl::Status s = ForwardLists(); !s.ok()) return s;
  return parts_.Take(array, bytes) ? absl::OkStatus() : next_.Write(array, bytes);
}

absl::Status CheckedLists::Finish() {
  if (absl::Status s = ForwardLists(); !s.ok()) return s;
  PartTable parts = parts_.table();
  if (absl::Status s = CheckTable(parts); !s.ok()) return s;
  size_t array = header_.first_part_array();
  for (const std::span<const uint8_t> bytes : ArraysOf(parts)) {
    if (absl::Status s = bytes.empty() ? absl::OkStatus() : next_.Write(array, bytes); !s.ok()) return s;
    ++array;
  }
  return absl::OkStatus();
}

absl::Status CheckedLists::ForwardLists() {
  if (std::exchange(forwarded_, true)) return absl::OkStatus();
  VoxelizeResult lists = held_.Take();
  lists.specs = header_.specs;
  std::vector<ArraySpec> announced = header_.arrays;
  announced.resize(header_.first_part_array());
  if (absl::Status s = CheckLists(lists, announced); !s.ok()) return s;
  const std::vector<std::span<const uint8_t>> arrays = ArraysOf(lists);
  for (size_t i = 0; i < arrays.size(); ++i) {
    if (arrays[i].empty()) continue;
    if (absl::Status s = next_.Write(i, arrays[i]); !s.ok()) return s;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
