#include "job/part_receiver.h"

#include <algorithm>
#include <vector>

namespace voxelpipe {

uint64_t PartReceiver::MemoryBytes(const ResultHeader& header) {
  uint64_t bytes = 0;
  for (size_t i = header.first_part_array(); i < header.arrays.size(); ++i) bytes += header.arrays[i].bytes();
  return bytes;
}

bool PartReceiver::Take(size_t array, std::span<const uint8_t> bytes) {
  if (array < first_ || table_.empty()) return false;
  if (array != std::exchange(array_, array)) offset_ = 0;
  const std::vector<std::span<uint8_t>> arrays = ArraysOf(table_);
  const std::span<uint8_t> to = arrays[std::min(array - first_, arrays.size() - 1)];
  const uint64_t count = std::min<uint64_t>(bytes.size(), to.size() - offset_);
  std::copy_n(bytes.begin(), count, to.begin() + ptrdiff_t(offset_));
  offset_ += count;
  return true;
}

}  // namespace voxelpipe
