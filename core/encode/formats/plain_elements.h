// Elements that every reader knows, of those that a result has.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "encode/npy.h"
#include "job/result.h"

namespace voxelpipe {

// The element that is written for one of a result: u8 for bits, f32 for halves, otherwise the same.
ElementType PlainTypeOf(ElementType type);

// Converts pieces of an array to plain elements: bits to bytes 0/1, halves to floats, the others unchanged. Pieces may
// end within an element.
class PlainElements {
 public:
  // `count`: elements of the array.
  PlainElements(ElementType type, uint64_t count) : type_(type), bits_(type, count) {}

  // The most memory that conversion takes.
  static uint64_t MemoryBytes(ElementType type, uint64_t count);

  using Output = std::function<absl::Status(std::span<const uint8_t>)>;
  // `bytes` are the next ones of the array. Calls `out` with the converted ones; returns its first error.
  absl::Status Write(std::span<const uint8_t> bytes, const Output& out);

 private:
  absl::Status WriteHalves(std::span<const uint8_t> bytes, const Output& out);

  ElementType type_;
  NpyElements bits_;
  std::vector<uint8_t> left_over_;  // the first byte of a half whose second has not arrived
  std::vector<float> widened_;
};

}  // namespace voxelpipe
