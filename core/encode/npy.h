// NumPy's array files.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "job/result.h"

namespace voxelpipe {

// Magic, version, length and the Python dictionary of a C-ordered array, padded so that the data starts at a multiple
// of 64 bytes. `descr` is NumPy's type string ("|u1", "<f4"). Version 1.0, or 2.0 if the dictionary exceeds 65,535
// bytes.
std::string NpyHeader(std::string_view descr, const std::vector<uint64_t>& shape);

// NumPy's type string of an array's elements; bits are written as uint8 0/1.
std::string_view NpyDescr(ElementType type);

// Bytes of `count` elements in a .npy.
uint64_t NpyBytes(ElementType type, uint64_t count);

// Converts pieces of an array to the elements of a .npy: bits become bytes, all others are unchanged.
class NpyElements {
 public:
  NpyElements(ElementType type, uint64_t count) : type_(type), left_(count) {}
  // The most memory that conversion takes.
  static uint64_t MemoryBytes(ElementType type, uint64_t count);

  using Output = std::function<absl::Status(std::span<const uint8_t>)>;
  // `bytes` are the next ones of the array; padding bits after its end are dropped.
  absl::Status Write(std::span<const uint8_t> bytes, const Output& out);

 private:
  ElementType type_;
  uint64_t left_;  // remaining elements
  std::vector<uint8_t> expanded_;
};

}  // namespace voxelpipe
