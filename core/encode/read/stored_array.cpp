#include "encode/read/stored_array.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "shaders/blend_ops.h"

namespace voxelpipe {
namespace {

static_assert(std::endian::native == std::endian::little, "elements are read as they lie in the file");

constexpr std::string_view kNames[] = {"bit", "|u1", "<u2", "<u4", "<i4", "<i8", "<f2", "<f4", "<f8"};
constexpr uint64_t kBits[] = {1, 8, 16, 32, 32, 64, 16, 32, 64};
constexpr uint64_t kMax = uint64_t{1} << 62;

template <typename T>
T Load(const uint8_t* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

}  // namespace

std::string_view Name(StoredType type) {
  return kNames[size_t(type)];
}

std::optional<StoredType> ParseStoredType(std::string_view name) {
  for (size_t i = 0; i < std::size(kNames); ++i) {
    if (kNames[i] == name) return StoredType(i);
  }
  return std::nullopt;
}

std::optional<uint64_t> ElementsOf(std::span<const uint64_t> shape) {
  uint64_t count = 1;
  for (const uint64_t n : shape) {
    if (n != 0 && count > kMax / n) return std::nullopt;
    count *= n;
  }
  return count;
}

std::optional<uint64_t> StoredBytes(StoredType type, uint64_t count) {
  if (count > kMax / 8) return std::nullopt;
  return (count * kBits[size_t(type)] + 7) / 8;
}

uint64_t StoredArray::count() const {
  return ElementsOf(shape).value_or(0);
}

ArrayReader::ArrayReader(StoredArray array, uint64_t first)
    : array_(std::move(array)), count_(array_.count()), next_(first) {}

absl::Status ArrayReader::Fill() {
  constexpr uint64_t kBufferBytes = 64 << 10;
  const uint64_t bits = kBits[size_t(array_.type)];
  begin_ = next_ / 8 * 8;  // a whole byte also of bits
  end_ = std::min(count_, begin_ + kBufferBytes * 8 / bits);
  buffer_.resize(((end_ - begin_) * bits + 7) / 8);
  return array_.file->ReadAt(array_.offset + begin_ * bits / 8, buffer_);
}

absl::Status ArrayReader::Advance(const uint8_t*& bytes) {
  if (next_ < begin_ || next_ >= end_) {
    if (absl::Status bad = Fill(); !bad.ok()) return bad;
  }
  bytes = buffer_.data() + (next_ - begin_) * kBits[size_t(array_.type)] / 8;
  ++next_;
  return absl::OkStatus();
}

absl::Status ArrayReader::Next(double& value) {
  const uint8_t* bytes = nullptr;
  if (absl::Status bad = Advance(bytes); !bad.ok()) return bad;
  switch (array_.type) {
    case StoredType::kBit: value = *bytes >> ((next_ - 1) % 8) & 1; break;
    case StoredType::kU8: value = *bytes; break;
    case StoredType::kU16: value = Load<uint16_t>(bytes); break;
    case StoredType::kU32: value = Load<uint32_t>(bytes); break;
    case StoredType::kI32: value = Load<int32_t>(bytes); break;
    case StoredType::kI64: value = double(Load<int64_t>(bytes)); break;
    case StoredType::kF16: value = double(FromHalf(Load<uint16_t>(bytes))); break;
    case StoredType::kF32: value = double(Load<float>(bytes)); break;
    case StoredType::kF64: value = Load<double>(bytes); break;
  }
  return absl::OkStatus();
}

absl::Status ArrayReader::NextInteger(int64_t& value) {
  if (array_.type != StoredType::kI64) {
    double number = 0;
    absl::Status bad = Next(number);
    value = int64_t(number);  // 32 bits at most
    return bad;
  }
  const uint8_t* bytes = nullptr;
  if (absl::Status bad = Advance(bytes); !bad.ok()) return bad;
  value = Load<int64_t>(bytes);
  return absl::OkStatus();
}

}  // namespace voxelpipe
