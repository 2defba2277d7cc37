// Source: Khronos Group, "glTF 2.0 Specification" (2021), section 3.7.2.1, topology types.
#include "load/gltf/geometry/gltf_topology.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe::gltf {

namespace {

constexpr uint64_t kElementsAStep = 1 << 16;  // between two polls of the job

absl::Status CheckCount(uint64_t count, const std::string& where, const LoadLimits& limits) {
  if (count <= limits.max_triangles) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("glTF: ", where, ": ", count, " triangles; the limit max_triangles is ", limits.max_triangles));
}

absl::Status CheckRange(const uint32_t* indices, uint64_t count, uint64_t vertices, const std::string& where,
                        const JobContext& job) {
  for (uint64_t begin = 0; begin < count; begin += kElementsAStep) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const uint64_t end = std::min(count, begin + kElementsAStep);
    uint32_t largest = 0;
    for (uint64_t i = begin; i < end; ++i) largest = std::max(largest, indices[i]);
    if (largest < vertices) continue;
    uint64_t i = begin;
    while (indices[i] < vertices) ++i;
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": index ", indices[i], " at position ", i,
                                                   " is out of range: there are ", vertices, " vertices"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckTriangles(const std::vector<std::array<uint32_t, 3>>& triangles, uint64_t vertices,
                            const std::string& where, const Budget& budget) {
  if (absl::Status bad = CheckCount(triangles.size(), where, budget.limits()); !bad.ok()) return bad;
  if (triangles.empty()) return absl::OkStatus();
  return CheckRange(triangles.front().data(), 3 * triangles.size(), vertices, where, budget.job());
}

absl::StatusOr<std::vector<std::array<uint32_t, 3>>> ExpandTriangles(
    int mode, const std::optional<std::vector<uint32_t>>& indices, uint64_t vertices, const std::string& where,
    Budget& budget, bool& incomplete) {
  const uint64_t corners = indices ? indices->size() : vertices;
  const uint64_t count = mode == kTriangles ? corners / 3 : (corners < 3 ? 0 : corners - 2);
  incomplete = mode == kTriangles ? corners % 3 != 0 : (corners == 1 || corners == 2);
  if (absl::Status bad = CheckCount(count, where, budget.limits()); !bad.ok()) return bad;
  if (indices) {
    absl::Status bad = CheckRange(indices->data(), corners, vertices, where, budget.job());
    if (!bad.ok()) return bad;
  }
  const auto at = [&](uint64_t i) { return indices ? (*indices)[i] : static_cast<uint32_t>(i); };

  std::vector<std::array<uint32_t, 3>> triangles;
  if (absl::Status full = budget.Take(count, sizeof(triangles[0]), where); !full.ok()) return full;
  triangles.reserve(count);
  for (uint64_t i = 0; i < count; ++i) {
    if (i % kElementsAStep == 0) {
      if (absl::Status over = budget.job().Check(); !over.ok()) return over;
    }
    switch (mode) {
      case kTriangleStrip: triangles.push_back({at(i), at(i + 1 + i % 2), at(i + 2 - i % 2)}); break;
      case kTriangleFan: triangles.push_back({at(i + 1), at(i + 2), at(0)}); break;
      default: triangles.push_back({at(3 * i), at(3 * i + 1), at(3 * i + 2)}); break;
    }
  }
  return triangles;
}

}  // namespace voxelpipe::gltf
