// Source: Khronos Group, "glTF 2.0 Specification" (2021), section 3.7.2.1, topology types.
#include "load/gltf_topology.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe::gltf {

absl::StatusOr<std::vector<std::array<uint32_t, 3>>> ExpandTriangles(
    int mode, const std::optional<std::vector<uint32_t>>& indices, uint64_t vertices, const std::string& where,
    const LoadLimits& limits, bool& incomplete) {
  const uint64_t corners = indices ? indices->size() : vertices;
  const uint64_t count = mode == kTriangles ? corners / 3 : (corners < 3 ? 0 : corners - 2);
  incomplete = mode == kTriangles ? corners % 3 != 0 : (corners == 1 || corners == 2);
  if (count > limits.max_triangles) {
    return absl::ResourceExhaustedError(
        absl::StrCat("glTF: ", where, ": ", count, " triangles; the limit max_triangles is ", limits.max_triangles));
  }
  if (indices) {
    for (uint64_t i = 0; i < corners; ++i) {
      if ((*indices)[i] >= vertices) {
        return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": index ", (*indices)[i], " at position ", i,
                                                       " is out of range: there are ", vertices, " vertices"));
      }
    }
  }
  const auto at = [&](uint64_t i) { return indices ? (*indices)[i] : static_cast<uint32_t>(i); };

  std::vector<std::array<uint32_t, 3>> triangles(count);
  for (uint64_t i = 0; i < count; ++i) {
    switch (mode) {
      case kTriangleStrip: triangles[i] = {at(i), at(i + 1 + i % 2), at(i + 2 - i % 2)}; break;
      case kTriangleFan: triangles[i] = {at(i + 1), at(i + 2), at(0)}; break;
      default: triangles[i] = {at(3 * i), at(3 * i + 1), at(3 * i + 2)}; break;
    }
  }
  return triangles;
}

}  // namespace voxelpipe::gltf
