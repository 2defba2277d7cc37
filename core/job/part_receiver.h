// Collects the table of parts of a result that is streamed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

#include "job/part_table.h"
#include "job/result.h"

namespace voxelpipe {

// For sinks: Begin with the header, then every piece to Take.
class PartReceiver {
 public:
  // Of the table of a result, which Begin allocates.
  static uint64_t MemoryBytes(const ResultHeader& header);
  void Begin(const ResultHeader& header) {
    first_ = header.first_part_array();
    table_ = MakePartTable(header.parts());
    array_ = offset_ = 0;
  }
  // True if `array` is one of the parts': its bytes, which follow those before, are taken.
  bool Take(size_t array, std::span<const uint8_t> bytes);
  // Complete after the result's last piece.
  const PartTable& table() const { return table_; }

 private:
  size_t first_ = 0;  // the number of the first array of parts
  PartTable table_;
  size_t array_ = 0;     // being received
  uint64_t offset_ = 0;  // of the next byte in it
};

}  // namespace voxelpipe
