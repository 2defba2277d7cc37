// Source: Khronos Group, "glTF 2.0 Specification" (2021), section 3.7.2.1, topology types.
#include "load/gltf_topology.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe::gltf {

namespace {

absl::Status CheckCount(uint64_t count, const std::string& where, const LoadLimits& limits) {
  if (count <= limits.max_triangles) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("glTF: ", where, ": ", count, " triangles; the limit max_triangles is ", limits.max_triangles));
}

absl::Status CheckRange(const uint32_t* indices, uint64_t count, uint64_t vertices, const std::string& where) {
  uint32_t largest = 0;
  for (uint64_t i = 0; i < count; ++i) largest = std::max(largest, indices[i]);
  if (count == 0 || largest < vertices) return absl::OkStatus();
  uint64_t i = 0;
  while (indices[i] < vertices) ++i;
  return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": index ", indices[i], " at position ", i,
                                                 " is out of range: there are ", vertices, " vertices"));
}

}  // namespace

absl::Status CheckTriangles(const std::vector<std::array<uint32_t, 3>>& triangles, uint64_t vertices,
                            const std::string& where, const LoadLimits& limits) {
  if (absl::Status bad = CheckCount(triangles.size(), where, limits); !bad.ok()) return bad;
  return triangles.empty() ? absl::OkStatus()
                           : CheckRange(triangles.front().data(), 3 * triangles.size(), vertices, where);
}

absl::StatusOr<std::vector<std::array<uint32_t, 3>>> ExpandTriangles(
    int mode, const std::optional<std::vector<uint32_t>>& indices, uint64_t vertices, const std::string& where,
    const LoadLimits& limits, bool& incomplete) {
  const uint64_t corners = indices ? indices->size() : vertices;
  const uint64_t count = mode == kTriangles ? corners / 3 : (corners < 3 ? 0 : corners - 2);
  incomplete = mode == kTriangles ? corners % 3 != 0 : (corners == 1 || corners == 2);
  if (absl::Status bad = CheckCount(count, where, limits); !bad.ok()) return bad;
  if (indices) {
    if (absl::Status bad = CheckRange(indices->data(), corners, vertices, where); !bad.ok()) return bad;
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
