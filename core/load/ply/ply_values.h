// The values of a PLY file's data, one after the other, as text or binary.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "load/base/text_reader.h"
#include "load/ply/ply_header.h"

namespace voxelpipe::ply {

// Words of text.
class TextValues {
 public:
  TextValues(std::string_view text, uint64_t first_line, const JobContext& job) : words_(text, first_line, &job) {}

  // False if there is no value, or none of that type: Fault says which.
  bool Float(Type, float& value) { return ReadReal(Next(), value); }
  bool Double(Type type, double& value) {
    if (type != Type::kFloat) return ReadReal(Next(), value);
    float rounded = 0;
    if (!ReadReal(Next(), rounded)) return false;
    value = rounded;
    return true;
  }
  bool Integer(Type, int64_t& value) {
    if (ReadInteger(Next(), value)) return true;
    float number = 0;  // "3.0"
    if (!ReadReal(word_, number) || number != std::trunc(number) || std::abs(number) > float(1 << 24)) return false;
    value = int64_t(number);
    return true;
  }
  bool Skip(Type, uint64_t count) {
    for (uint64_t i = 0; i < count; ++i) {
      if (Next().empty()) return false;
    }
    return true;
  }

  std::string Fault() const {
    if (word_.empty()) return "the file ends";
    return absl::StrCat("line ", words_.line(), ": ", Quote(word_), " is no number of its type");
  }
  // What no element took, for a warning; empty if nothing is left.
  std::string Unread() { return Next().empty() ? "" : absl::StrCat("the lines from ", words_.line(), " on"); }
  // The largest number of values that the rest may have.
  uint64_t left() const { return words_.left() / 2 + 1; }
  static constexpr uint64_t CostOf(Type) { return 1; }

 private:
  std::string_view Next() { return word_ = words_.Next(); }

  WordStream words_;
  std::string_view word_;
};

// Numbers in binary.
template <bool kBigEndian>
class BinaryValues {
 public:
  explicit BinaryValues(std::span<const uint8_t> bytes) : bytes_(bytes) {}

  bool Float(Type type, float& value) { return Real(type, value); }
  bool Double(Type type, double& value) { return Real(type, value); }
  // Of each corner of a face.
  ABSL_ATTRIBUTE_ALWAYS_INLINE bool Integer(Type type, int64_t& value) {
    if (left() < SizeOf(type)) return false;
    switch (type) {
      case Type::kInt8: value = Take<int8_t>(); return true;
      case Type::kUint8: value = Take<uint8_t>(); return true;
      case Type::kInt16: value = Take<int16_t>(); return true;
      case Type::kUint16: value = Take<uint16_t>(); return true;
      case Type::kInt32: value = Take<int32_t>(); return true;
      case Type::kUint32: value = Take<uint32_t>(); return true;
      case Type::kFloat:
      case Type::kDouble: break;
    }
    return false;
  }
  bool Skip(Type type, uint64_t count) {
    if (count > left() / SizeOf(type)) return false;
    at_ += count * SizeOf(type);
    return true;
  }

  std::string Fault() const { return "the file ends"; }
  std::string Unread() const { return left() == 0 ? "" : absl::StrCat("the last ", left(), " bytes"); }
  uint64_t left() const { return bytes_.size() - at_; }
  static constexpr uint64_t CostOf(Type type) { return SizeOf(type); }

 private:
  template <typename Out>
  bool Real(Type type, Out& value) {
    if (IsFloat(type)) {
      if (left() < SizeOf(type)) return false;
      if (type == Type::kFloat) {
        value = Take<float>();
      } else {
        value = Out(Take<double>());
      }
      return true;
    }
    int64_t integer = 0;
    if (!Integer(type, integer)) return false;
    value = Out(integer);
    return true;
  }
  template <typename T>
  T Take() {
    uint8_t raw[sizeof(T)];
    std::memcpy(raw, bytes_.data() + at_, sizeof raw);
    if constexpr (kBigEndian) std::reverse(raw, raw + sizeof raw);
    T value;
    std::memcpy(&value, raw, sizeof value);
    at_ += sizeof raw;
    return value;
  }

  std::span<const uint8_t> bytes_;
  uint64_t at_ = 0;
};

}  // namespace voxelpipe::ply
