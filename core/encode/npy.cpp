// Source: "NEP 1: A Simple File Format for NumPy Arrays", R. Kern, 2007, and numpy/lib/format.py for version 2.0.
#include "encode/npy.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

static_assert(std::endian::native == std::endian::little, "targets are written as they lie in memory");

// Table: the eight bits of each byte value as eight bytes 0/1, lowest first.
constexpr auto kExpanded = [] {
  std::array<std::array<uint8_t, 8>, 256> table{};
  for (int value = 0; value < 256; ++value) {
    for (int bit = 0; bit < 8; ++bit) table[value][bit] = uint8_t((value >> bit) & 1);
  }
  return table;
}();

constexpr size_t kPieceBytes = size_t{512} << 10;  // of bits

}  // namespace

std::string NpyHeader(std::string_view descr, const std::vector<uint64_t>& shape) {
  std::string dictionary = absl::StrCat("{'descr': '", std::string(descr), "', 'fortran_order': False, 'shape': (");
  for (size_t i = 0; i < shape.size(); ++i) absl::StrAppend(&dictionary, i > 0 ? ", " : "", shape[i]);
  // A tuple of one element needs a comma.
  absl::StrAppend(&dictionary, shape.size() == 1 ? ",), }" : "), }");

  constexpr size_t kAlignment = 64;
  const auto padded = [&](size_t prefix) {  // dictionary and newline, so that prefix + result is aligned
    return (prefix + dictionary.size() + 1 + kAlignment - 1) / kAlignment * kAlignment - prefix;
  };
  const bool version1 = padded(10) <= 0xffff;
  const size_t length = padded(version1 ? 10 : 12);
  std::string header("\x93NUMPY", 6);
  header += version1 ? '\x01' : '\x02';
  header += '\x00';
  for (int byte = 0; byte < (version1 ? 2 : 4); ++byte) header += char((length >> (8 * byte)) & 0xff);
  header += dictionary;
  header.append(length - dictionary.size() - 1, ' ');
  header += '\n';
  return header;
}

std::string_view NpyDescr(ElementType type) {
  switch (type) {
    case ElementType::kBit:
    case ElementType::kU8: return "|u1";
    case ElementType::kU16: return "<u2";
    case ElementType::kU32: return "<u4";
    case ElementType::kU64: return "<u8";
    case ElementType::kF16: return "<f2";
    case ElementType::kF32: return "<f4";
    case ElementType::kI32: return "<i4";
  }
  return "|u1";
}

uint64_t NpyBytes(ElementType type, uint64_t count) {
  return type == ElementType::kBit ? count : ArrayBytes(type, count);
}

uint64_t NpyElements::MemoryBytes(ElementType type, uint64_t count) {
  return type == ElementType::kBit ? std::min<uint64_t>(count + 8, kPieceBytes * 8) : 0;
}

absl::Status NpyElements::Write(std::span<const uint8_t> bytes, const Output& out) {
  if (type_ != ElementType::kBit) return out(bytes);
  for (size_t begin = 0; begin < bytes.size(); begin += kPieceBytes) {
    const std::span<const uint8_t> piece = bytes.subspan(begin, std::min(kPieceBytes, bytes.size() - begin));
    expanded_.resize(piece.size() * 8);
    for (size_t i = 0; i < piece.size(); ++i) std::memcpy(&expanded_[i * 8], kExpanded[piece[i]].data(), 8);
    const uint64_t count = std::min<uint64_t>(left_, expanded_.size());
    left_ -= count;
    if (absl::Status s = out({expanded_.data(), size_t(count)}); !s.ok()) return s;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
