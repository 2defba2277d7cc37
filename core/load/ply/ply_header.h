// The header of a PLY file: what its data is made of.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "load/base/load_budget.h"

namespace voxelpipe::ply {

enum class Encoding { kAscii, kLittleEndian, kBigEndian };
enum class Type { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

struct Property {
  std::string name;
  Type type = Type::kFloat;  // of the values
  bool list = false;
  Type count_type = Type::kUint8;  // of a list's number of values
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
  uint64_t line = 0;  // of its declaration
};

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;  // in the order of their data, names distinct
  uint64_t data_at = 0;           // the first byte behind the header
  uint64_t data_line = 0;         // the number of the line that begins there
  bool names_texture = false;     // by a comment, as MeshLab writes it
};

// Bytes of a value in binary data.
uint64_t SizeOf(Type type);
inline bool IsFloat(Type type) {
  return type == Type::kFloat || type == Type::kDouble;
}

// In: the whole file. Errors: INVALID_ARGUMENT naming the line.
absl::StatusOr<Header> ReadHeader(std::string_view text, const LoadBudget& budget);

}  // namespace voxelpipe::ply
