// The data part of a glTF document: buffers, buffer views, accessors and images as declared, nothing resolved yet.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/vec.h"
#include "base/warning.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe::gltf {

struct BufferDecl {
  std::optional<std::string> uri;
  uint64_t byte_length = 0;
  bool fallback = false;  // meshopt compression: a placeholder without data
};

// The EXT_meshopt_compression or KHR_meshopt_compression object of a buffer view.
struct MeshoptDecl {
  bool khr = false;
  uint32_t buffer = 0;
  uint64_t offset = 0, length = 0, stride = 0, count = 0;
  std::string mode, filter = "NONE";
};

struct ViewDecl {
  uint32_t buffer = 0;
  uint64_t offset = 0, length = 0;
  uint64_t stride = 0;  // 0 = tightly packed
  std::optional<MeshoptDecl> meshopt;
};

struct SparseDecl {
  uint64_t count = 0;
  uint32_t index_view = 0, value_view = 0;
  uint64_t index_offset = 0, value_offset = 0;
  int index_type = 0;
};

struct AccessorDecl {
  int64_t view = -1;  // -1 = zeros
  uint64_t offset = 0, count = 0;
  int component_type = 0;  // 5120-5126
  int components = 0;      // 1-4; 4, 9, 16 for matrices
  bool matrix = false;
  bool normalized = false;
  std::optional<SparseDecl> sparse;
};

struct ImageDecl {
  std::string name, mime_type;
  std::optional<std::string> uri;
  int64_t view = -1;
};

struct Document {
  std::vector<BufferDecl> buffers;
  std::vector<ViewDecl> views;
  std::vector<AccessorDecl> accessors;
  std::vector<ImageDecl> images;
  std::shared_ptr<nlohmann::json> graph;  // the rest (scenes, nodes, meshes, skins, materials), checked and stripped
  std::shared_ptr<nlohmann::json> animations;  // the array of animations of the file, unchecked; null without one
  MemoryCharge memory;                         // the charge of all this to the job's memory
  bool has_scenes = false;                     // at least one
  std::optional<Vec3d> rtc_center;             // CESIUM_RTC: a translation of everything drawn
  WarningList warnings;
};

// In: the JSON text, already past GuardJson. Out: declarations with every index proved to be in range of its array, and
// every buffer view in range of its buffer's declared length.
// Errors: INVALID_ARGUMENT naming the object: broken JSON, a version other than 2.x, an unknown required extension, a
// wrong type, a dangling index. RESOURCE_EXHAUSTED naming the limit.
absl::StatusOr<Document> ParseDocument(const JobContext& job, std::string_view json, const LoadLimits& limits);

// componentType of 64-bit floats, of the extension KHR_accessor_float64.
inline constexpr int kDoubleComponents = 5130;

// Bytes of one component, 0 for an unknown type.
uint32_t ComponentBytes(int component_type);

}  // namespace voxelpipe::gltf
