// Text as the bytes of a mesh file, and what loading it gives.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "load/loader.h"

namespace voxelpipe::testing {

inline std::vector<uint8_t> TextBytes(std::string_view text) {
  return {text.begin(), text.end()};
}

inline absl::StatusOr<Scene> LoadText(std::string_view text, MeshFileType type = {}, const LoadLimits& limits = {}) {
  return LoadScene(TextBytes(text), type, limits);
}

// The error of a text, "" if it loads.
inline std::string ErrorOf(std::string_view text, MeshFormat format = MeshFormat::kAuto,
                           const LoadLimits& limits = {}) {
  const absl::StatusOr<Scene> scene = LoadText(text, format, limits);
  return scene.ok() ? "" : std::string(scene.status().message());
}

// All triangles of the first mesh as positions, in order.
inline std::vector<Vec3f> CornersOf(const Scene& scene) {
  std::vector<Vec3f> corners;
  for (const Primitive& primitive : scene.meshes.at(0).primitives) {
    for (const auto& triangle : primitive.triangles) {
      for (const uint32_t vertex : triangle) corners.push_back(primitive.positions.at(vertex));
    }
  }
  return corners;
}

}  // namespace voxelpipe::testing
