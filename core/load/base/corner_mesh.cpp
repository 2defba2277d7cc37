#include "load/base/corner_mesh.h"

#include <utility>

#include "base/long_loops.h"
#include "load/base/flat_scene.h"

namespace voxelpipe {
namespace {

constexpr int kMaxSteps = 8;
constexpr uint64_t kCornersAStep = 1 << 14;  // between two polls of the job

bool Same(const CornerMesh::Corner& a, const CornerMesh::Corner& b) {
  return a.uv == b.uv && a.normal == b.normal && a.color == b.color;
}

}  // namespace

absl::Status CornerMesh::Begin(int32_t material, const Corner& kind) {
  if (!primitives_.empty()) {
    const Primitive& last = primitives_.back();
    const bool same = last.material == material && last.uv[0].empty() == (kind.uv == kNone) &&
                      last.normals.empty() == (kind.normal == kNone) && last.colors.empty() == (kind.color == kNone);
    if (same) return absl::OkStatus();
    before_ += last.positions.size();
  }
  entries_.clear();
  if (absl::Status full = budget_.MakeRoom(primitives_, 1, "parts"); !full.ok()) return full;
  primitives_.emplace_back();
  primitives_.back().material = material;
  return absl::OkStatus();
}

absl::StatusOr<uint32_t> CornerMesh::VertexOf(const Corner& corner) {
  if (first_.size() <= corner.position) {
    const uint64_t more = lists_.positions->size() - first_.size();
    if (absl::Status full = budget_.MakeRoom(first_, more, "vertices"); !full.ok()) return full;
    if (absl::Status over = Resize(budget_.job(), first_, lists_.positions->size()); !over.ok()) return over;
  }
  uint64_t& first = first_[corner.position];
  const uint32_t newest = first > before_ ? uint32_t(first - 1 - before_) : kNone;
  uint32_t at = newest;
  for (int step = 0; step < kMaxSteps && at != kNone; ++step) {
    if (Same(entries_[at].corner, corner)) return at;
    at = entries_[at].next;
  }
  Primitive& out = primitives_.back();
  if (absl::Status full = budget_.CheckVertices(before_ + entries_.size() + 1); !full.ok()) return full;
  absl::Status full = budget_.MakeRoom(entries_, 1, "vertices");
  if (full.ok() && corner.uv != kNone) full = budget_.MakeRoom(out.uv[0], 1, "texture coordinates");
  if (full.ok() && corner.normal != kNone) full = budget_.MakeRoom(out.normals, 1, "normals");
  if (full.ok() && corner.color != kNone) full = budget_.MakeRoom(out.colors, 1, "colours");
  if (!full.ok()) return full;
  const auto vertex = uint32_t(entries_.size());
  full = AddPosition((*lists_.positions)[corner.position], budget_, out);
  if (!full.ok()) return full;
  entries_.push_back({corner, newest});
  if (corner.uv != kNone) out.uv[0].push_back((*lists_.uv)[corner.uv]);
  if (corner.normal != kNone) out.normals.push_back((*lists_.normals)[corner.normal]);
  if (corner.color != kNone) out.colors.push_back((*lists_.colors)[corner.color]);
  first = before_ + vertex + 1;
  return vertex;
}

absl::Status CornerMesh::AddPolygon(std::span<const Corner> corners, int32_t material) {
  if (corners.size() < 3) return absl::OkStatus();
  triangles_ += corners.size() - 2;
  if (absl::Status full = budget_.CheckTriangles(triangles_); !full.ok()) return full;
  bool uv = true, normal = true, color = true;
  for (const Corner& corner : corners) {
    uv = uv && corner.uv != kNone;
    normal = normal && corner.normal != kNone;
    color = color && corner.color != kNone;
  }
  const Corner kind{0, uv ? 0 : kNone, normal ? 0 : kNone, color ? 0 : kNone};
  if (absl::Status full = Begin(material, kind); !full.ok()) return full;
  polygon_.clear();
  if (absl::Status full = budget_.MakeRoom(polygon_, corners.size(), "a face"); !full.ok()) return full;
  corners_ += corners.size();
  if (corners_ >= kCornersAStep) {
    corners_ = 0;
    if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
  }
  uint64_t left = kCornersAStep;
  for (Corner corner : corners) {
    if (--left == 0) {
      if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
      left = kCornersAStep;
    }
    const auto drop = [&](bool kept, uint32_t& value) {
      if (kept) return;
      mixed_ = mixed_ || value != kNone;
      value = kNone;
    };
    drop(uv, corner.uv);
    drop(normal, corner.normal);
    drop(color, corner.color);
    const absl::StatusOr<uint32_t> vertex = VertexOf(corner);
    if (!vertex.ok()) return vertex.status();
    polygon_.push_back(*vertex);
  }
  return polygons_.Add(polygon_, primitives_.back());
}

std::vector<Primitive> CornerMesh::Take(WarningList& warnings) {
  budget_.Drop(first_);
  budget_.Drop(entries_);
  budget_.Drop(polygon_);
  polygons_.Finish(warnings);
  return std::move(primitives_);
}

}  // namespace voxelpipe
