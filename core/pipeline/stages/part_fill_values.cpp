#include "pipeline/stages/part_fill_values.h"

#include <algorithm>
#include <cstring>

#include "pipeline/stages/target_rules.h"
#include "shaders/interface/fragment_input.h"
#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

bool HasOwnRule(const TargetSpec& spec) {
  return spec.format == VoxelFormat::kBit || !spec.fill_values.empty() || spec.blend == Blend::kCount;
}

bool SameOutput(const FragmentOutput& a, const FragmentOutput& b) {
  return std::memcmp(a.f, b.f, sizeof a.f) == 0 && std::memcmp(a.u, b.u, sizeof a.u) == 0 && a.discard == b.discard;
}

// True if the shader gives the same all over the triangle: no texture and no vertex colours take part.
bool IsSameAllOver(FragmentShaderId id, const FragmentInput& in) {
  const MaterialView& material = in.material();
  const bool plain_color = material.base_color.texture < 0 && !in.part->has_colors;
  const bool plain_alpha = plain_color || !material.alpha_mask;
  switch (id) {
    case FragmentShaderId::kBaseColor: return plain_color;
    case FragmentShaderId::kEmissive: return plain_alpha && material.emissive.texture < 0;
    case FragmentShaderId::kMetallicRoughness: return plain_alpha && material.metallic_roughness.texture < 0;
    default: return SameForTriangle(id, in);
  }
}

// The output that all triangles of the runs [first, last) have; false if they differ.
bool OutputOf(const BoundShader& shader, const MeshView& mesh, uint32_t first, uint32_t last, FragmentOutput& out) {
  const auto id = FragmentShaderId(shader.id);
  for (uint32_t run = first; run < last; ++run) {
    const uint64_t begin = mesh.parts[run].first_triangle;
    const uint64_t end = run + 1 < mesh.part_count ? mesh.parts[run + 1].first_triangle : mesh.triangle_count;
    const FragmentInput in = MakePlainInput(mesh, uint32_t(begin));
    if (!IsSameAllOver(id, in)) return false;
    if (id == FragmentShaderId::kTriangleId && end - begin > 1) return false;
    FragmentOutput here;
    ShadeFragment(id, in, shader.params, here);
    if (run > first && !SameOutput(here, out)) return false;
    out = here;
  }
  return true;
}

}  // namespace

bool FillsByPart(const BoundRequest& request, size_t index) {
  if (!FillsParts(request.request) || HasOwnRule(request.request.targets[index])) return false;
  const auto id = FragmentShaderId(request.fragment_shaders[index].id);
  const bool moves =
      id == FragmentShaderId::kVelocity && request.bodies_move && request.request.parts.scope == PartScope::kFile;
  return moves || GivesValuesOfParts(request.request, request.request.targets[index]);
}

std::vector<RigidMotionNumbers> MotionsByRank(const TriangleMesh& mesh, const BoundRequest& request) {
  std::vector<RigidMotionNumbers> motions;
  if (!request.bodies_move || request.request.parts.scope != PartScope::kFile || request.parts == nullptr)
    return motions;
  motions.resize(request.parts->parts.size());
  for (const Part& part : request.parts->parts) {
    const std::optional<RigidMotionNumbers>& motion = mesh.placed[part.placed].motion;
    if (motion) motions[part.rank] = *motion;
  }
  return motions;
}

std::vector<FillValue> PartFillValues(const BoundRequest& request, size_t index, const MeshView& mesh,
                                      const std::vector<RigidMotionNumbers>& motions, const GridSpec& grid) {
  const BoundShader& shader = request.fragment_shaders[index];
  std::vector<FillValue> values;
  if (FragmentShaderId(shader.id) == FragmentShaderId::kVelocity) {
    const FillValue whole = VelocityFillValue(request, index, grid);
    values.assign(motions.size(), whole);
    for (size_t rank = 0; rank < motions.size() && whole.kind == FillValue::Kind::kVelocity; ++rank) {
      values[rank].kind = FillValue::Kind::kTwoVelocities;
      const Vec3d numbers[] = {motions[rank].linear, motions[rank].angular, motions[rank].center};
      for (int i = 0; i < RigidMotion::kParameters; ++i) values[rank].further[i] = numbers[i / 3][i % 3];
    }
    return values;
  }
  const FillValue clear = FillValueOf(request, index, grid);
  for (uint32_t first = 0; first < mesh.part_count && mesh.triangle_count > 0;) {
    uint32_t last = first;
    while (last < mesh.part_count && mesh.parts[last].rank == mesh.parts[first].rank) ++last;
    values.push_back(clear);
    FragmentOutput out;
    if (OutputOf(shader, mesh, first, last, out) && !out.discard) {
      const bool u32 = shader.info->output_type == "u32";
      for (int c = 0; c < 4; ++c) {
        values.back().stored[c] = StoredBits(ToCell(out, u32, c, clear.format, clear.scale), clear.format);
      }
    }
    first = last;
  }
  return values;
}

}  // namespace voxelpipe
