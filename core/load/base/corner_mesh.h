// Primitives from corners that combine values of several lists, as OBJ and 3MF have them.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "load/base/load_budget.h"
#include "load/base/polygons.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// Corners with the same values share a vertex. The order of the polygons is kept: a change of material, or of the kinds
// of values, begins a new primitive. Linear in time and memory whatever the indices are.
class CornerMesh {
 public:
  static constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

  // The lists that corners refer to, as long as this is used. They may grow.
  struct Lists {
    const std::vector<Vec3d>* positions = nullptr;
    const std::vector<Vec2f>* uv = nullptr;
    const std::vector<Vec3f>* normals = nullptr;
    const std::vector<Vec4f>* colors = nullptr;  // linear
  };
  // Indices into the lists, proved to be in range; kNone: no value.
  struct Corner {
    uint32_t position = 0, uv = kNone, normal = kNone, color = kNone;
  };

  CornerMesh(Lists lists, LoadBudget& budget) : lists_(lists), budget_(budget), polygons_(budget) {}

  // Adds the triangles of a polygon (Polygons::Add). A value that not all corners have is left out, and `mixed` set.
  // Errors: RESOURCE_EXHAUSTED; the job's.
  absl::Status AddPolygon(std::span<const Corner> corners, int32_t material);

  uint64_t triangles() const { return triangles_; }
  bool mixed() const { return mixed_; }
  // The primitives; those that a polygon began, in file order. Adds a warning of polygons (Polygons::Finish).
  std::vector<Primitive> Take(WarningList& warnings);

 private:
  // The vertex of the current primitive with these values. At most kMaxSteps others are compared: beyond, it is a
  // second one with the same values.
  absl::StatusOr<uint32_t> VertexOf(const Corner& corner);
  absl::Status Begin(int32_t material, const Corner& kind);

  struct Entry {
    Corner corner;
    uint32_t next = kNone;  // another vertex of this position
  };

  const Lists lists_;
  LoadBudget& budget_;
  Polygons polygons_;
  std::vector<Primitive> primitives_;
  std::vector<uint64_t> first_;  // by position: the number of its newest vertex over all primitives, plus one
  std::vector<Entry> entries_;   // of the current primitive's vertices
  std::vector<uint32_t> polygon_;
  uint64_t before_ = 0;   // vertices of the primitives before the current one
  uint64_t corners_ = 0;  // since the last poll of the job
  uint64_t triangles_ = 0;
  bool mixed_ = false;
};

}  // namespace voxelpipe
