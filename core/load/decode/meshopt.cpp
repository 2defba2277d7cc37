// Source: EXT_meshopt_compression (glTF vendor extension, 2020-2022) and KHR_meshopt_compression (2025): modes, filters
// and their stride rules.
#include "load/decode/meshopt.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <new>

#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "load/decode/foreign_decoders.h"
#include "load/decode/meshopt_vertex_v1.h"

namespace voxelpipe {
namespace {

// The codec's best case, all vertices equal: four header bytes for each byte lane of a block of 256 vertices. The index
// modes expand a byte to at most 12. More is a decompression bomb.
constexpr uint64_t kMaxDecodedPerByte = 64;
// Version 1 of the vertex codec: a byte for four byte lanes of a block of 256 vertices.
constexpr uint64_t kMaxDecodedPerByteV1 = 1024;

std::string NameOf(const MeshoptView& view) {
  return view.khr ? "KHR_meshopt_compression" : "EXT_meshopt_compression";
}

absl::Status Invalid(const MeshoptView& view, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat(NameOf(view), ": ", why));
}

absl::Status CheckStride(const MeshoptView& view) {
  const uint64_t stride = view.byte_stride;
  if (view.mode == "ATTRIBUTES") {
    if (stride == 0 || stride > 256 || stride % 4 != 0) {
      return Invalid(view,
                     absl::StrCat("byteStride ", stride, " of mode ATTRIBUTES must be a multiple of 4 up to 256"));
    }
  } else if (view.mode == "TRIANGLES" || view.mode == "INDICES") {
    if (stride != 2 && stride != 4)
      return Invalid(view, absl::StrCat("byteStride ", stride, " of indices must be 2 or 4"));
    if (view.filter != "NONE") return Invalid(view, absl::StrCat("mode ", view.mode, " takes no filter"));
    if (view.mode == "TRIANGLES" && view.count % 3 != 0) {
      return Invalid(view, absl::StrCat("count ", view.count, " of mode TRIANGLES is not a multiple of 3"));
    }
  } else {
    return Invalid(view, absl::StrCat("unknown mode '", view.mode, "'"));
  }
  const bool fits = view.filter == "NONE" || (view.filter == "OCTAHEDRAL" && (stride == 4 || stride == 8)) ||
                    (view.filter == "QUATERNION" && stride == 8) || view.filter == "EXPONENTIAL" ||
                    (view.khr && view.filter == "COLOR" && (stride == 4 || stride == 8));
  if (!fits) return Invalid(view, absl::StrCat("filter '", view.filter, "' with byteStride ", stride, " is not valid"));
  return absl::OkStatus();
}

int DecodeStream(std::span<const uint8_t> compressed, const MeshoptView& view, std::vector<uint8_t>& out) {
  const size_t count = size_t(view.count), stride = size_t(view.byte_stride);
  if (view.mode == "ATTRIBUTES") {
    if (view.khr && MeshoptVertexVersion(compressed) == 1) {
      return DecodeMeshoptVertexV1(compressed, view.byte_stride, out) ? 0 : -1;
    }
    return meshopt_decodeVertexBuffer(out.data(), count, stride, compressed.data(), compressed.size());
  }
  if (view.mode == "TRIANGLES") {
    return meshopt_decodeIndexBuffer(out.data(), count, stride, compressed.data(), compressed.size());
  }
  return meshopt_decodeIndexSequence(out.data(), count, stride, compressed.data(), compressed.size());
}

// Filter COLOR: Y, Co, Cg and alpha of fewer bits -> R, G, B, A of all bits of T. The highest set bit of alpha is not
// part of its value: it encodes the number of bits of all four.
template <typename T, typename Signed>
void DecodeColors(std::vector<uint8_t>& bytes) {
  constexpr int kBits = 8 * sizeof(T), kMaxValue = (1 << kBits) - 1;
  for (size_t at = 0; at + 4 * sizeof(T) <= bytes.size(); at += 4 * sizeof(T)) {
    T in[4];
    std::memcpy(in, bytes.data() + at, sizeof in);
    const int y = in[0], co = Signed(in[1]), cg = Signed(in[2]), alpha = in[3];
    const int scale =
        alpha == 0 ? 0 : (1 << std::bit_width(unsigned(alpha))) - 1;  // the largest value of that many bits
    const int rgba[4] = {y + co - cg, y + cg, y - co - cg, ((alpha << 1) & scale) | (alpha & 1)};
    for (int c = 0; c < 4; ++c) {
      const double full = scale == 0 ? 0 : double(rgba[c]) * kMaxValue / scale;
      in[c] = T(std::clamp(std::floor(full + 0.5), 0.0, double(kMaxValue)));
    }
    std::memcpy(bytes.data() + at, in, sizeof in);
  }
}

}  // namespace

absl::StatusOr<std::vector<uint8_t>> DecodeMeshopt(std::span<const uint8_t> compressed, const MeshoptView& view) {
  if (absl::Status s = CheckForeignDecoders(); !s.ok()) return s;
  if (absl::Status s = CheckStride(view); !s.ok()) return s;
  const auto bytes = CheckedMul(view.count, view.byte_stride);
  const bool v1 = view.khr && view.mode == "ATTRIBUTES" && MeshoptVertexVersion(compressed) == 1;
  if (!bytes || *bytes / (v1 ? kMaxDecodedPerByteV1 : kMaxDecodedPerByte) > compressed.size()) {
    return Invalid(view, absl::StrCat("count ", view.count, " is more than ", compressed.size(), " bytes can hold"));
  }
  std::vector<uint8_t> out;
  try {
    out.resize(size_t(*bytes));
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(NameOf(view) + ": out of memory");
  }
  if (view.count == 0) return out;
  if (DecodeStream(compressed, view, out) != 0)
    return Invalid(view, absl::StrCat("the stream of mode ", view.mode, " is broken"));
  const size_t count = size_t(view.count), stride = size_t(view.byte_stride);
  if (view.filter == "OCTAHEDRAL") meshopt_decodeFilterOct(out.data(), count, stride);
  if (view.filter == "QUATERNION") meshopt_decodeFilterQuat(out.data(), count, stride);
  if (view.filter == "EXPONENTIAL") meshopt_decodeFilterExp(out.data(), count, stride);
  if (view.filter == "COLOR" && stride == 4) DecodeColors<uint8_t, int8_t>(out);
  if (view.filter == "COLOR" && stride == 8) DecodeColors<uint16_t, int16_t>(out);
  return out;
}

}  // namespace voxelpipe
