#include "load/base/polygons.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "base/long_loops.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kWorkACorner = 256;       // looks at a corner or a cell
constexpr uint32_t kCornersAStep = 1 << 14;  // between two polls of the job
// As far as a triangle of the fan may reach out of the polygon by rounded coordinates: so much of its longest edge, and
// of the coordinates themselves.
constexpr double kRounding = 1e-6, kFloatRounding = 0x1p-22, kDoubleRounding = 0x1p-50;

// Relative to the first corner, which loses no digits that its distance has.
Vec3d Edge(std::span<const uint32_t> corners, const Primitive& mesh, size_t i) {
  return PositionOf(mesh, corners[i]) - PositionOf(mesh, corners[0]);
}

double LongestEdge2(const Vec3d& a, const Vec3d& b) {
  const Vec3d c = b - a;
  return std::max({Dot(a, a), Dot(b, b), Dot(c, c)});
}

// Twice the area of a triangle, positive if it is counterclockwise.
template <typename Point>
double Area(const Point& a, const Point& b, const Point& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

}  // namespace

absl::Status Polygons::Add(std::span<const uint32_t> corners, Primitive& out) {
  if (corners.size() < 3) return absl::OkStatus();
  const uint64_t more = corners.size() - 2;
  if (absl::Status full = budget_.CheckTriangles(out.triangles.size() + more); !full.ok()) return full;
  if (absl::Status full = budget_.MakeRoom(out.triangles, more, "triangles"); !full.ok()) return full;
  Vec3d normal;
  if (corners.size() > 3 && !IsFanRight(corners, out, normal)) {
    if (absl::Status bad = Project(corners, out, normal); !bad.ok()) return bad;
    const absl::StatusOr<bool> clipped = ClipEars();
    if (!clipped.ok()) return clipped.status();
    if (*clipped) {
      for (const auto& [a, b, c] : ears_) out.triangles.push_back({corners[a], corners[b], corners[c]});
      return absl::OkStatus();
    }
    ++crossing_;
  }
  for (size_t i = 2; i < corners.size(); ++i) {
    if (i % kCornersAStep == 0) {
      if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
    }
    out.triangles.push_back({corners[0], corners[i - 1], corners[i]});
  }
  return absl::OkStatus();
}

bool Polygons::IsFanRight(std::span<const uint32_t> corners, const Primitive& mesh, Vec3d& normal) const {
  normal = {};
  Vec3d a = Edge(corners, mesh, 1);
  for (size_t i = 2; i < corners.size(); ++i) {
    if (i % kCornersAStep == 0 && !budget_.job().Check().ok()) return true;
    const Vec3d b = Edge(corners, mesh, i);
    normal = normal + Cross(a, b);
    a = b;
  }
  const Vec3d first = PositionOf(mesh, corners[0]);
  const double far = std::max({std::abs(first.x), std::abs(first.y), std::abs(first.z)});
  const double rounding = far * (mesh.double_positions.empty() ? kFloatRounding : kDoubleRounding);
  const double length = std::sqrt(Dot(normal, normal));
  a = Edge(corners, mesh, 1);
  for (size_t i = 2; i < corners.size(); ++i) {
    if (i % kCornersAStep == 0 && !budget_.job().Check().ok()) return true;
    const Vec3d b = Edge(corners, mesh, i);
    if (const double turned = Dot(Cross(a, b), normal); turned < 0) {
      const double longest = std::sqrt(LongestEdge2(a, b));
      if (turned < -length * longest * (kRounding * longest + rounding)) return false;
    }
    a = b;
  }
  return true;
}

absl::Status Polygons::Project(std::span<const uint32_t> corners, const Primitive& mesh, const Vec3d& normal) {
  // The axis that the polygon faces most is left out; the other two keep their handedness.
  const double ax = std::abs(normal.x), ay = std::abs(normal.y), az = std::abs(normal.z);
  const int axis = ax >= ay && ax >= az ? 0 : (ay >= az ? 1 : 2);
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const double turn = normal[axis] < 0 ? -1 : 1;
  const auto count = uint32_t(corners.size());
  corners_.clear();
  if (absl::Status full = budget_.MakeRoom(corners_, count, "a face"); !full.ok()) return full;
  for (uint32_t i = 0; i < count; ++i) {
    if (absl::Status over = Poll(i); !over.ok()) return over;
    const Vec3d p = Edge(corners, mesh, i);
    corners_.push_back({turn * p[u], p[v], i == 0 ? count - 1 : i - 1, i + 1 == count ? 0 : i + 1});
  }
  return absl::OkStatus();
}

absl::Status Polygons::Poll(uint64_t i) const {
  return i % kCornersAStep == 0 ? budget_.job().Check() : absl::OkStatus();
}

std::array<uint32_t, 2> Polygons::CellOf(double x, double y) const {
  const auto cell = [&](double at, double min, uint32_t cells) {
    return uint32_t(std::clamp((at - min) * cells_a_unit_, 0.0, double(cells - 1)));
  };
  return {cell(x, min_x_, cells_x_), cell(y, min_y_, cells_y_)};
}

absl::Status Polygons::SortReflex() {
  double max_x = corners_[0].x, max_y = corners_[0].y;
  min_x_ = max_x;
  min_y_ = max_y;
  uint64_t reflex = 0;
  for (size_t i = 0; i < corners_.size(); ++i) {
    if (absl::Status over = Poll(i); !over.ok()) return over;
    Corner& corner = corners_[i];
    corner.is_reflex = Area(corners_[corner.previous], corner, corners_[corner.next]) <= 0;
    reflex += corner.is_reflex ? 1 : 0;
    min_x_ = std::min(min_x_, corner.x);
    min_y_ = std::min(min_y_, corner.y);
    max_x = std::max(max_x, corner.x);
    max_y = std::max(max_y, corner.y);
  }
  // Square cells, as many as reflex corners.
  const double wide = max_x - min_x_, high = max_y - min_y_, many = double(reflex) + 1;
  cells_a_unit_ = std::sqrt(many / std::max(wide * high, std::numeric_limits<double>::min()));
  const auto cells_of = [&](double length) { return uint32_t(std::clamp(length * cells_a_unit_, 1.0, many)); };
  cells_x_ = cells_of(wide);
  cells_y_ = cells_of(high);
  const uint64_t cells = uint64_t(cells_x_) * cells_y_;
  cell_begin_.clear();
  cell_corners_.clear();
  if (absl::Status full = budget_.MakeRoom(cell_begin_, cells + 1, "a face"); !full.ok()) return full;
  if (absl::Status full = budget_.MakeRoom(cell_corners_, reflex, "a face"); !full.ok()) return full;
  if (absl::Status over = Resize(budget_.job(), cell_begin_, cells + 1); !over.ok()) return over;
  if (absl::Status over = Resize(budget_.job(), cell_corners_, reflex); !over.ok()) return over;
  const auto number = [&](const Corner& corner) {
    const auto [x, y] = CellOf(corner.x, corner.y);
    return size_t(x) + size_t(y) * cells_x_;
  };
  for (size_t i = 0; i < corners_.size(); ++i) {
    if (absl::Status over = Poll(i); !over.ok()) return over;
    if (corners_[i].is_reflex) ++cell_begin_[number(corners_[i])];
  }
  for (size_t cell = 1; cell <= cells; ++cell) cell_begin_[cell] += cell_begin_[cell - 1];
  for (uint32_t i = 0; i < corners_.size(); ++i) {
    if (absl::Status over = Poll(i); !over.ok()) return over;
    if (corners_[i].is_reflex) cell_corners_[--cell_begin_[number(corners_[i])]] = i;
  }
  return absl::OkStatus();
}

bool Polygons::IsEar(uint32_t at, bool strict) {
  const Corner& b = corners_[at];
  const Corner &a = corners_[b.previous], &c = corners_[b.next];
  const double area = Area(a, b, c);
  if (area < 0) return false;
  if (area == 0) return (a.x - b.x) * (c.x - b.x) + (a.y - b.y) * (c.y - b.y) <= 0;  // on the edge between the others
  const auto [x0, y0] = CellOf(std::min({a.x, b.x, c.x}), std::min({a.y, b.y, c.y}));
  const auto [x1, y1] = CellOf(std::max({a.x, b.x, c.x}), std::max({a.y, b.y, c.y}));
  for (uint32_t y = y0; y <= y1; ++y) {
    for (uint32_t x = x0; x <= x1; ++x) {
      const size_t cell = size_t(x) + size_t(y) * cells_x_;
      work_ += 1 + cell_begin_[cell + 1] - cell_begin_[cell];
      for (uint32_t n = cell_begin_[cell]; n < cell_begin_[cell + 1]; ++n) {
        const uint32_t other = cell_corners_[n];
        const Corner& p = corners_[other];
        if (!p.is_reflex || other == at || other == b.previous || other == b.next) continue;
        const double ab = Area(a, b, p), bc = Area(b, c, p), ca = Area(c, a, p);
        if (strict ? ab >= 0 && bc >= 0 && ca >= 0 : ab > 0 && bc > 0 && ca > 0) return false;
      }
    }
  }
  return true;
}

void Polygons::Cut(uint32_t at) {
  Corner& corner = corners_[at];
  ears_.push_back({corner.previous, at, corner.next});
  corners_[corner.previous].next = corner.next;
  corners_[corner.next].previous = corner.previous;
  corner.is_cut = true;
  corner.is_reflex = false;
  for (const uint32_t neighbour : {corner.previous, corner.next}) {
    Corner& n = corners_[neighbour];
    if (n.is_reflex) n.is_reflex = Area(corners_[n.previous], n, corners_[n.next]) <= 0;
  }
}

absl::StatusOr<bool> Polygons::ClipEars() {
  const auto count = uint32_t(corners_.size());
  ears_.clear();
  work_ = 0;
  if (absl::Status full = budget_.MakeRoom(ears_, count - 2, "a face"); !full.ok()) return full;
  if (absl::Status full = SortReflex(); !full.ok()) return full;
  const uint64_t own = kWorkACorner * count, limit = own + more_work_;
  uint32_t at = 0, left = count;
  bool strict = true, going_on = true;
  while (left > 3 && going_on) {
    // Corners become ears where a neighbour was cut, or later, when no other corner lies in their triangle any more.
    candidates_.clear();
    if (absl::Status full = budget_.MakeRoom(candidates_, 3 * uint64_t{left}, "a face"); !full.ok()) return full;
    for (uint32_t n = 0; n < left; ++n, at = corners_[at].next) candidates_.push_back(at);
    const uint32_t before = left;
    uint64_t polled = work_;
    for (size_t next = 0; next < candidates_.size() && left > 3 && going_on; ++next) {
      if (work_ - polled >= kCornersAStep) {
        polled = work_;
        if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
      }
      going_on = ++work_ <= limit;
      const uint32_t candidate = candidates_[next];
      if (corners_[candidate].is_cut || !IsEar(candidate, strict)) continue;
      Cut(candidate);
      --left;
      at = corners_[candidate].next;
      if (!strict) break;
      candidates_.push_back(corners_[candidate].previous);
      candidates_.push_back(corners_[candidate].next);
    }
    // Where edges or corners touch each other, as at the bridge to a hole, the last ears have corners on their border.
    going_on = going_on && (left < before || strict);
    strict = left < before;
  }
  if (work_ > own) more_work_ -= std::min(more_work_, work_ - own);
  if (left > 3) return false;
  const Corner& last = corners_[at];
  ears_.push_back({last.previous, at, last.next});
  return Area(corners_[last.previous], last, corners_[last.next]) >= 0;
}

void Polygons::Finish(WarningList& warnings) {
  budget_.Drop(ears_);
  budget_.Drop(corners_);
  budget_.Drop(candidates_);
  budget_.Drop(cell_begin_);
  budget_.Drop(cell_corners_);
  if (crossing_ == 0) return;
  warnings.Add(WarningCode::kNonconformingFile, "faces",
               absl::StrCat(crossing_, " concave faces cross themselves or are too intricate; they are read as fans ",
                            "from their first corner"));
}

}  // namespace voxelpipe
