// The model parts of a 3MF package: objects, resources and the build, as written.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "base/warning.h"
#include "load/base/corner_mesh.h"
#include "load/base/load_budget.h"
#include "load/threemf/zip_archive.h"

namespace voxelpipe::threemf {

// An object of a part. Parts are numbered in the order in which they are read; the root is 0.
struct Reference {
  std::string path;  // of the part; empty: the part that has the reference
  int64_t object = 0;
  Mat4d transform;  // of column vectors
  uint64_t line = 0;
};

// Values that triangles refer to by (pid, index).
struct PropertyGroup {
  enum class Kind { kMaterials, kColors, kTexture, kOther };
  Kind kind = Kind::kOther;
  std::vector<std::string> names;  // kMaterials
  std::vector<Vec4f> colors;       // kMaterials, kColors: sRGB
  std::vector<Vec2f> uv;           // kTexture: origin at the bottom
  int64_t texture = 0;             // kTexture: id of a Texture2d
};

struct Texture2d {
  std::string path, content_type;
  bool clamp_u = false, clamp_v = false, mirror_u = false, mirror_v = false, nearest = false;
};

struct Triangle {
  static constexpr int64_t kNone = -1;
  std::array<uint32_t, 3> vertices{};
  int64_t group = kNone;  // the id of a PropertyGroup
  std::array<int64_t, 3> properties{};
};

struct Object {
  int64_t id = 0;
  std::string name;
  std::vector<Vec3d> vertices;
  std::vector<Triangle> triangles;
  std::vector<Reference> components;
  int64_t group = Triangle::kNone, property = 0;  // of triangles without
  uint64_t line = 0;
};

struct ModelPart {
  std::string name;  // of the archive's entry
  std::string unit = "millimeter";
  std::map<int64_t, Object> objects;
  std::map<int64_t, PropertyGroup> groups;
  std::map<int64_t, Texture2d> textures;
  std::vector<Reference> build;
};

// In: the entry of a part. Out: its contents; every triangle refers to vertices of its object. Elements of extensions
// that are not read give a warning each. Errors: INVALID_ARGUMENT naming part and line; RESOURCE_EXHAUSTED; the job's.
absl::StatusOr<ModelPart> ReadModelPart(ZipArchive& archive, const std::string& entry, LoadBudget& budget,
                                        WarningList& warnings);

}  // namespace voxelpipe::threemf
