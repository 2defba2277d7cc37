// Describes the targets of a request for kernels and for the path plan.
#include <algorithm>

#include "cuda/run/run_state.h"
#include "pipeline/stages/target_rules.h"
#include "raster/filtered/fixed_point.h"
#include "raster/row_bits_fit.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cuda {

uint32_t PatternOf(const CudaTarget& target) {
  const int bits = BitsPerComponent(target.format);
  return target.clear_stored * (bits == 8 ? 0x01010101u : bits == 16 ? 0x00010001u : 1);
}

CudaTarget DescribeTarget(const TargetSpec& spec, const BoundShader& shader) {
  CudaTarget t;
  t.format = KeptFormat(spec);
  t.blend = spec.blend;
  t.components = spec.components;
  t.shader = FragmentShaderId(shader.id);
  t.params = shader.params;
  t.u32_output = shader.info->output_type == "u32";
  t.quantum = spec.quantum;
  t.scale = ScaleOf(spec, shader);
  t.clear_stored = StoredBits(NumberToCell(spec.clear, spec.format), spec.format);
  t.is_occupancy = spec.format == VoxelFormat::kBit && t.shader == FragmentShaderId::kOccupancy;
  t.may_discard = t.own_presence = TraitsOf(t.shader).can_discard;
  return t;
}

void DescribeTargets(RunState& state) {
  const VoxelizeRequest& request = state.request.request;
  const MeshView& mesh = state.host.view;
  state.targets = {};
  state.targets.count = int(request.targets.size());
  state.targets.planar = request.layout == Layout::kPlanar;
  for (size_t i = 0; i < request.targets.size(); ++i) {
    CudaTarget& target = state.targets.at[i];
    target = DescribeTarget(request.targets[i], state.request.fragment_shaders[i]);
    // A shader that discards nothing of this mesh counts as one that never discards.
    target.may_discard = std::any_of(mesh.parts, mesh.parts + mesh.part_count, [&](const PartView& part) {
      return MayDiscard(target.shader, mesh.materials[part.material]);
    });
    state.targets.any_always_present = state.targets.any_always_present || !target.may_discard;
    // Where every value is 1, also that of filled voxels, owners make no difference.
    target.of_owner = HoldsOwner(request, request.targets[i]) && !(target.is_occupancy && FillBit(request.targets[i]));
    if (target.of_owner) target.is_occupancy = false;  // the owner may have no fragment where others have
    target.own_presence = target.may_discard || target.of_owner;
  }
}

bool ShadesFragments(const BoundRequest& request) {
  for (size_t i = 0; i < request.request.targets.size(); ++i) {
    if (!DescribeTarget(request.request.targets[i], request.fragment_shaders[i]).is_occupancy) return true;
  }
  return false;
}

namespace {

// True if every triangle of the shaded mesh has one value for all its fragments, and the blend depends on values alone.
bool IsUniform(const RunState& state, const CudaTarget& target) {
  if (target.may_discard || !IsUniformKept(KeptBy(target))) return false;
  MeshView mesh = state.host.view;
  mesh.velocities = state.mesh.host_view.velocities;  // shaders only check for null
  for (uint32_t i = 0; i < mesh.part_count; ++i) {
    FragmentInput in;
    in.mesh = &mesh;
    in.part = mesh.parts + i;
    if (!SameForTriangle(target.shader, in)) return false;
  }
  return true;
}

}  // namespace

uint64_t FineTriangles(const DeviceInfo& device) {
  constexpr uint64_t kMinBlocks = 16, kThreads = 256;
  return (AssumedCache() > 0 ? 1 : uint64_t(device.multiprocessors) * kMinBlocks) * kThreads;
}

bool IsFine(const RunState& state) {
  return state.mesh.host_view.triangle_count >= FineTriangles(state.device);
}

PathInputs PathInputsOf(const RunState& state, const GridSpec& grid) {
  const VoxelizeRequest& request = state.request.request;
  PathInputs in;
  in.result = request.result;
  in.coverage = request.coverage;
  in.fill = request.fill;
  in.by_parts = state.parts.filled;
  in.planar = request.layout == Layout::kPlanar;
  in.target_count = state.targets.count;
  for (int i = 0; i < in.target_count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    PathTarget& of = in.targets[size_t(i)];
    of.format = target.format;
    of.blend = target.blend;
    of.components = target.components;
    of.clears_to_zero = target.clear_stored == 0;
    of.is_occupancy = target.is_occupancy;
    of.may_discard = target.may_discard;
    of.same_for_triangle = IsUniform(state, target);
  }
  in.triangles = state.host.view.triangle_count;
  in.rows_fit = RowBitsFit(grid, in.triangles);
  if (in.triangles > 0 && in.coverage != Coverage::kCenter) {
    const IndexSpace space = grid.index_space();
    const Vec3d low = WorldToIndex(space, state.box.min), high = WorldToIndex(space, state.box.max);
    in.fixed_point = MakeFixedPlace(space, low, high).bits > 0;
  } else {
    in.fixed_point = false;
  }
  in.fine_triangles = FineTriangles(state.device);
  return in;
}

}  // namespace voxelpipe::cuda
