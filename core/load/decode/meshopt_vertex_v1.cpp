// Source: A. Kapoulkine, "KHR_meshopt_compression" (glTF extension, 2025), appendix on mode 0 (attributes), bitstream
// version 1. Debian's libmeshoptimizer 0.18 decodes version 0 alone.
//
// A stream is a header byte, blocks of vertices, padding, and a tail: the vertex before the first one and a byte for
// each channel (4 bytes of the stride) that gives the encoding of its differences. A block begins with 2 bits for each
// byte of the stride, its control: the encoding of that byte in the block's vertices.
#include "load/decode/meshopt_vertex_v1.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

namespace voxelpipe {
namespace {

constexpr uint8_t kHeader = 0xa0;
constexpr uint64_t kMaxStride = 256, kMaxBlockVertices = 256, kMaxBlockBytes = 8192, kGroup = 16, kMinTailBytes = 24;

// The control of one byte of the stride in a block.
enum Control { kSmallGroups = 0, kLargeGroups = 1, kZeros = 2, kLiteral = 3 };

// Reads bytes to the stream's end. After a read past the end, `ok` is false and all reads return 0.
class Reader {
 public:
  explicit Reader(std::span<const uint8_t> bytes) : left_(bytes) {}

  std::span<const uint8_t> Take(uint64_t count) {
    if (count > left_.size()) {
      ok_ = false;
      return {};
    }
    const std::span<const uint8_t> taken = left_.first(count);
    left_ = left_.subspan(count);
    return taken;
  }
  uint8_t Byte() {
    const std::span<const uint8_t> byte = Take(1);
    return byte.empty() ? uint8_t{0} : byte[0];
  }
  bool ok() const { return ok_; }
  uint64_t left() const { return left_.size(); }

 private:
  std::span<const uint8_t> left_;
  bool ok_ = true;
};

// 16 values of `bits` bits each; the largest value is an escape: the byte follows the group. Single bits lie lowest
// first, wider values highest first.
void ReadGroup(Reader& in, int bits, uint8_t* out) {
  if (bits == 0) return void(std::memset(out, 0, kGroup));
  const std::span<const uint8_t> packed = in.Take(kGroup * uint64_t(bits) / 8);
  if (packed.empty()) return;
  if (bits == 8) return void(std::memcpy(out, packed.data(), kGroup));
  const uint64_t values_per_byte = 8 / uint64_t(bits);
  const auto escape = uint8_t((1 << bits) - 1);
  for (uint64_t i = 0; i < kGroup; ++i) {
    const uint64_t in_byte = i % values_per_byte;
    const uint64_t shift = bits == 1 ? in_byte : (values_per_byte - 1 - in_byte) * uint64_t(bits);
    const auto value = uint8_t((packed[i / values_per_byte] >> shift) & escape);
    out[i] = value == escape ? in.Byte() : value;
  }
}

// Decodes one byte of `count` vertices into `out`, which must hold whole groups.
void ReadLane(Reader& in, int control, uint64_t count, uint8_t* out) {
  if (control == kZeros) return void(std::memset(out, 0, count));
  if (control == kLiteral) {
    const std::span<const uint8_t> bytes = in.Take(count);
    if (!bytes.empty()) std::memcpy(out, bytes.data(), count);
    return;
  }
  constexpr int kBits[2][4] = {{0, 1, 2, 4}, {1, 2, 4, 8}};
  const uint64_t groups = (count + kGroup - 1) / kGroup;
  const std::span<const uint8_t> widths = in.Take((groups + 3) / 4);
  for (uint64_t g = 0; g < groups && in.ok(); ++g) {
    ReadGroup(in, kBits[control][(widths[g / 4] >> (g % 4 * 2)) & 3], out + g * kGroup);
  }
}

// A channel's differences of `count` vertices -> its values; `lanes`: its four bytes, kMaxBlockVertices apart. T: the
// type of a value.
template <typename T, bool kXor>
void AddUp(const uint8_t* lanes, uint64_t count, uint64_t stride, int rotation, const uint8_t* last, uint8_t* out) {
  for (uint64_t first = 0; first < 4; first += sizeof(T)) {
    T value = 0;
    for (uint64_t b = 0; b < sizeof(T); ++b) value = T(value | T(last[first + b]) << (8 * b));
    for (uint64_t i = 0; i < count; ++i) {
      T delta = 0;
      for (uint64_t b = 0; b < sizeof(T); ++b) {
        delta = T(delta | T(lanes[(first + b) * kMaxBlockVertices + i]) << (8 * b));
      }
      if constexpr (kXor) {
        value = T(value ^ std::rotl(delta, rotation));
      } else {
        value = T(value + T(T(delta >> 1) ^ T(-T(delta & 1))));  // zigzag: the lowest bit is the sign
      }
      for (uint64_t b = 0; b < sizeof(T); ++b) out[i * stride + first + b] = uint8_t(value >> (8 * b));
    }
  }
}

bool DecodeBlock(Reader& in, uint64_t count, uint64_t stride, const uint8_t* last, std::span<const uint8_t> channels,
                 uint8_t* out) {
  const std::span<const uint8_t> control = in.Take(stride / 4);
  if (!in.ok()) return false;
  std::array<uint8_t, 4 * kMaxBlockVertices> lanes;
  for (uint64_t c = 0; c < stride / 4; ++c) {
    for (uint64_t b = 0; b < 4; ++b) {
      ReadLane(in, (control[c] >> (2 * b)) & 3, count, lanes.data() + b * kMaxBlockVertices);
    }
    if (!in.ok()) return false;
    const uint8_t* const before = last + 4 * c;
    uint8_t* const to = out + 4 * c;
    switch (channels[c] & 3) {
      case 0: AddUp<uint8_t, false>(lanes.data(), count, stride, 0, before, to); break;
      case 1: AddUp<uint16_t, false>(lanes.data(), count, stride, 0, before, to); break;
      case 2:
        // Kept rotated to the left by the upper four bits.
        AddUp<uint32_t, true>(lanes.data(), count, stride, (32 - (channels[c] >> 4)) & 31, before, to);
        break;
      default: return false;
    }
  }
  return true;
}

}  // namespace

int MeshoptVertexVersion(std::span<const uint8_t> compressed) {
  if (compressed.empty() || (compressed[0] & 0xf0) != kHeader) return -1;
  return compressed[0] & 0x0f;
}

bool DecodeMeshoptVertexV1(std::span<const uint8_t> compressed, uint64_t stride, std::span<uint8_t> out) {
  if (stride == 0 || stride > kMaxStride || stride % 4 != 0 || out.size() % stride != 0) return false;
  const uint64_t tail_bytes = stride + stride / 4, padded_bytes = std::max(tail_bytes, kMinTailBytes);
  if (MeshoptVertexVersion(compressed) != 1 || compressed.size() < 1 + padded_bytes) return false;
  const std::span<const uint8_t> tail = compressed.last(tail_bytes);
  Reader in(compressed.first(compressed.size() - padded_bytes).subspan(1));

  const uint64_t vertices = out.size() / stride;
  const uint64_t block = std::min(kMaxBlockBytes / stride / kGroup * kGroup, kMaxBlockVertices);
  const uint8_t* last = tail.data();
  for (uint64_t v = 0; v < vertices; v += block) {
    const uint64_t count = std::min(block, vertices - v);
    uint8_t* const to = out.data() + v * stride;
    if (!DecodeBlock(in, count, stride, last, tail.subspan(stride), to)) return false;
    last = to + (count - 1) * stride;
  }
  return in.left() == 0;
}

}  // namespace voxelpipe
