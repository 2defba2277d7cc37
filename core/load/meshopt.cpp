// Source: EXT_meshopt_compression (glTF vendor extension, 2020-2022): modes, filters and their stride rules.
#include "load/meshopt.h"

#include <meshoptimizer.h>

#include <new>

#include "absl/strings/str_cat.h"
#include "base/checked.h"

namespace voxelpipe {
namespace {

// The codec's best case, all vertices equal: four header bytes for each byte lane of a block of 256 vertices. The index
// modes give at most 12 bytes for one. More is a bomb.
constexpr uint64_t kMaxDecodedPerByte = 64;

absl::Status Invalid(const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat("EXT_meshopt_compression: ", why));
}

absl::Status CheckStride(const MeshoptView& view) {
  const uint64_t stride = view.byte_stride;
  if (view.mode == "ATTRIBUTES") {
    if (stride == 0 || stride > 256 || stride % 4 != 0) {
      return Invalid(absl::StrCat("byteStride ", stride, " of mode ATTRIBUTES must be a multiple of 4 up to 256"));
    }
  } else if (view.mode == "TRIANGLES" || view.mode == "INDICES") {
    if (stride != 2 && stride != 4) return Invalid(absl::StrCat("byteStride ", stride, " of indices must be 2 or 4"));
    if (view.filter != "NONE") return Invalid(absl::StrCat("mode ", view.mode, " takes no filter"));
    if (view.mode == "TRIANGLES" && view.count % 3 != 0) {
      return Invalid(absl::StrCat("count ", view.count, " of mode TRIANGLES is not a multiple of 3"));
    }
  } else {
    return Invalid(absl::StrCat("unknown mode '", view.mode, "'"));
  }
  const bool fits = view.filter == "NONE" || (view.filter == "OCTAHEDRAL" && (stride == 4 || stride == 8)) ||
                    (view.filter == "QUATERNION" && stride == 8) || view.filter == "EXPONENTIAL";
  if (!fits) return Invalid(absl::StrCat("filter '", view.filter, "' with byteStride ", stride, " is not valid"));
  return absl::OkStatus();
}

int DecodeStream(std::span<const uint8_t> compressed, const MeshoptView& view, std::vector<uint8_t>& out) {
  const size_t count = size_t(view.count), stride = size_t(view.byte_stride);
  if (view.mode == "ATTRIBUTES") {
    return meshopt_decodeVertexBuffer(out.data(), count, stride, compressed.data(), compressed.size());
  }
  if (view.mode == "TRIANGLES") {
    return meshopt_decodeIndexBuffer(out.data(), count, stride, compressed.data(), compressed.size());
  }
  return meshopt_decodeIndexSequence(out.data(), count, stride, compressed.data(), compressed.size());
}

}  // namespace

absl::StatusOr<std::vector<uint8_t>> DecodeMeshopt(std::span<const uint8_t> compressed, const MeshoptView& view,
                                                   const LoadLimits& limits) {
  if (absl::Status s = CheckStride(view); !s.ok()) return s;
  const auto bytes = CheckedMul(view.count, view.byte_stride);
  if (!bytes || *bytes / kMaxDecodedPerByte > compressed.size()) {
    return Invalid(absl::StrCat("count ", view.count, " is more than ", compressed.size(), " bytes can hold"));
  }
  if (*bytes > limits.max_decoded_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat("EXT_meshopt_compression: ", *bytes, " decoded bytes, the limit is ", limits.max_decoded_bytes));
  }
  std::vector<uint8_t> out;
  try {
    out.resize(size_t(*bytes));
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("EXT_meshopt_compression: out of memory");
  }
  if (view.count == 0) return out;
  if (DecodeStream(compressed, view, out) != 0)
    return Invalid(absl::StrCat("the stream of mode ", view.mode, " is broken"));
  const size_t count = size_t(view.count), stride = size_t(view.byte_stride);
  if (view.filter == "OCTAHEDRAL") meshopt_decodeFilterOct(out.data(), count, stride);
  if (view.filter == "QUATERNION") meshopt_decodeFilterQuat(out.data(), count, stride);
  if (view.filter == "EXPONENTIAL") meshopt_decodeFilterExp(out.data(), count, stride);
  return out;
}

}  // namespace voxelpipe
