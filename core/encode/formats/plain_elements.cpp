#include "encode/formats/plain_elements.h"

#include <algorithm>

#include "shaders/blend_ops.h"

namespace voxelpipe {
namespace {

constexpr size_t kPiece = 1 << 18;  // elements

}  // namespace

ElementType PlainTypeOf(ElementType type) {
  if (type == ElementType::kBit) return ElementType::kU8;
  return type == ElementType::kF16 ? ElementType::kF32 : type;
}

uint64_t PlainElements::MemoryBytes(ElementType type, uint64_t count) {
  if (type == ElementType::kF16) return std::min<uint64_t>(count, kPiece) * sizeof(float);
  return NpyElements::MemoryBytes(type, count);
}

absl::Status PlainElements::Write(std::span<const uint8_t> bytes, const Output& out) {
  if (type_ == ElementType::kF16) return WriteHalves(bytes, out);
  return bits_.Write(bytes, out);
}

absl::Status PlainElements::WriteHalves(std::span<const uint8_t> bytes, const Output& out) {
  // At most twice what it has to hold, as a growing list has.
  widened_.reserve(std::min(kPiece, bytes.size() / 2 + 1));
  const auto emit = [&] {
    const absl::Status s = out({reinterpret_cast<const uint8_t*>(widened_.data()), widened_.size() * sizeof(float)});
    widened_.clear();
    return s;
  };
  for (const uint8_t byte : bytes) {
    left_over_.push_back(byte);
    if (left_over_.size() < 2) continue;
    widened_.push_back(FromHalf(uint16_t(left_over_[0] | left_over_[1] << 8)));
    left_over_.clear();
    if (widened_.size() < kPiece) continue;
    if (absl::Status s = emit(); !s.ok()) return s;
  }
  return widened_.empty() ? absl::OkStatus() : emit();
}

}  // namespace voxelpipe
