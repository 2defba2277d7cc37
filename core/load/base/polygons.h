// Triangles of the polygons of plain mesh formats.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "base/warning.h"
#include "load/base/load_budget.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// Triangulates the polygons of one file. Not thread-safe.
class Polygons {
 public:
  explicit Polygons(LoadBudget& budget) : budget_(budget) {}

  // In: the corners of a polygon in order, vertices of `out`. Adds corners - 2 triangles to it; nothing for fewer than
  // 3 corners. They are the fan (0, 1, 2), (0, 2, 3), ... where it covers the polygon, so always if that is convex;
  // otherwise ears, seen along the polygon's normal, with the winding of the polygon. A polygon that crosses itself, or
  // has no area, is a fan. The time is in proportion to the corners: a polygon that takes more than its part, and than
  // 0.1 s for the whole file, is a fan, too. Errors: RESOURCE_EXHAUSTED; the job's.
  // Source: G. Meisters, "Polygons have ears", The American Mathematical Monthly 82 (1975).
  absl::Status Add(std::span<const uint32_t> corners, Primitive& out);

  // After the last polygon: frees what this holds, and adds a warning if concave polygons became fans.
  void Finish(WarningList& warnings);

 private:
  // A corner in the plane of the polygon, counterclockwise; its neighbours among those that are left.
  struct Corner {
    double x = 0, y = 0;
    uint32_t previous = 0, next = 0;
    bool is_reflex = false, is_cut = false;
  };

  // True if no triangle of the fan is turned against the polygon. `normal`: of the polygon, as long as twice its area.
  bool IsFanRight(std::span<const uint32_t> corners, const Primitive& mesh, Vec3d& normal) const;
  // The polygon in its plane.
  absl::Status Project(std::span<const uint32_t> corners, const Primitive& mesh, const Vec3d& normal);
  // The triangles of the projected polygon, as numbers of corners. False if no ear is left, or the work is more than
  // its part.
  absl::StatusOr<bool> ClipEars();
  // The job's error, every kCornersAStep elements.
  absl::Status Poll(uint64_t i) const;
  // Sorts the reflex corners into the cells of a grid.
  absl::Status SortReflex();
  // True if the corner is convex and its triangle holds no reflex corner. `strict`: neither on its border.
  bool IsEar(uint32_t corner, bool strict);
  void Cut(uint32_t corner);
  std::array<uint32_t, 2> CellOf(double x, double y) const;

  LoadBudget& budget_;
  std::vector<std::array<uint32_t, 3>> ears_;
  std::vector<Corner> corners_;
  std::vector<uint32_t> candidates_;                 // corners that may be ears
  std::vector<uint32_t> cell_begin_, cell_corners_;  // reflex corners by cell
  uint32_t cells_x_ = 0, cells_y_ = 0;
  double min_x_ = 0, min_y_ = 0, cells_a_unit_ = 0;
  uint64_t work_ = 0;                       // looks at a corner or a cell, of the polygon
  uint64_t more_work_ = uint64_t{1} << 24;  // that polygons of the file may take beyond their part
  uint64_t crossing_ = 0;
};

}  // namespace voxelpipe
