#include "support/reference/fill_reference.h"

#include <algorithm>
#include <vector>

#include "support/reference/value_reference.h"

namespace voxelpipe::testing {
namespace {

std::vector<double> Numbers(const ShaderCall& call, const char* name, std::vector<double> otherwise) {
  const auto given = call.parameters.find(name);
  return given == call.parameters.end() ? otherwise : given->second;
}

Vec3d Vector(const ShaderCall& call, const char* name) {
  const std::vector<double> v = Numbers(call, name, {0, 0, 0});
  return {v[0], v[1], v[2]};
}

// Shades a filled voxel without a triangle; false if the shader needs one.
bool ShadeCentre(const VoxelizeRequest& request, const ShaderCall& shader, const GridSpec& grid,
                 const int64_t (&voxel)[3], FragmentOutput& out) {
  Vec3d p;
  for (int a = 0; a < 3; ++a) p[a] = grid.origin[a] + (double(voxel[a]) + 0.5) * grid.voxel_size[a];
  if (shader.name == "occupancy") return out.f[0] = 1, true;
  if (shader.name == "constant") {
    const std::vector<double> value = Numbers(shader, "value", {1, 0, 0, 1});
    for (size_t i = 0; i < value.size(); ++i) out.f[i] = float(value[i]);
    return true;
  }
  if (shader.name == "checker") {
    const auto size = int64_t(Numbers(shader, "size", {8})[0]);
    int64_t cell = 0;
    for (const int64_t at : voxel) cell += at / size;
    out.f[0] = float(cell % 2 == 0 ? Numbers(shader, "even", {1})[0] : Numbers(shader, "odd", {0})[0]);
    return true;
  }
  if (shader.name == "position") {
    for (int a = 0; a < 3; ++a) out.f[a] = float(p[a]);
    return true;
  }
  const ShaderCall& moves = request.vertex_shader;
  if (shader.name != "velocity" || Numbers(moves, "dt", {0})[0] > 0) return false;
  const Vec3d linear = Vector(moves, "linear_velocity"), w = Vector(moves, "angular_velocity");
  const Vec3d r = p - Vector(moves, "center");
  const Vec3d turn{w.y * r.z - w.z * r.y, w.z * r.x - w.x * r.z, w.x * r.y - w.y * r.x};
  for (int a = 0; a < 3; ++a) out.f[a] = float(linear[a] + turn[a]);
  return true;
}

}  // namespace

uint32_t ReferenceFill(const VoxelizeRequest& request, size_t index, const GridSpec& grid, int64_t x, int64_t y,
                       int64_t z, int c) {
  const TargetSpec& spec = request.targets[index];
  if (!spec.fill_values.empty()) {
    return ReferenceNumber(spec.fill_values[std::min(size_t(c), spec.fill_values.size() - 1)], spec.format);
  }
  if (spec.format == VoxelFormat::kBit) return 1;
  if (spec.blend == Blend::kCount) return 0;
  FragmentOutput out;
  if (!ShadeCentre(request, spec.shader, grid, {x, y, z}, out)) return ReferenceNumber(spec.clear, spec.format);
  TargetSpec replaced = spec;
  replaced.blend = Blend::kReplace;
  return ReferenceBlend(replaced, {out}, c);
}

}  // namespace voxelpipe::testing
