#include "pipeline/stages/target_rules.h"

#include <algorithm>
#include <iterator>
#include <string_view>

#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

// Slots of the vertex shader's own numbers, before those of RigidMotion.
int OwnParameters(VertexShaderId id) {
  switch (id) {
#define VOXELPIPE_CASE(name) \
  case VertexShaderId::k##name: return name##VertexShader::kParameters;
    VOXELPIPE_VERTEX_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return 0;
}

// Whether the vertex shader itself gives velocities, besides those of the rigid motion.
bool GivesVelocities(const ShaderCall& vertex_shader) {
  const auto dt = vertex_shader.parameters.find("dt");
  return dt != vertex_shader.parameters.end() && dt->second.at(0) > 0;
}

void StoreNumber(double number, const TargetSpec& spec, uint32_t& stored) {
  stored = StoredBits(NumberToCell(number, spec.format), spec.format);
}

// The motion of the vertex shader at each voxel's centre.
void SetMotion(const BoundRequest& request, FillValue& fill) {
  fill.kind = FillValue::Kind::kVelocity;
  std::copy_n(request.vertex_shader.params.value + OwnParameters(VertexShaderId(request.vertex_shader.id)),
              RigidMotion::kParameters, fill.parameters);
}

// The same output in all voxels.
void StoreOutput(const FragmentOutput& out, FillValue& fill) {
  for (int c = 0; c < 4; ++c) {
    fill.stored[c] = StoredBits(ToCell(out, false, c, fill.format, fill.scale), fill.format);
  }
}

}  // namespace

VoxelFormat KeptFormat(const TargetSpec& spec) {
  switch (spec.encoding) {
    case Encoding::kLinear: return spec.format;
    case Encoding::kSrgb: return VoxelFormat::kU8Srgb;
    case Encoding::kSnorm: return spec.format == VoxelFormat::kU8 ? VoxelFormat::kU8Snorm : VoxelFormat::kU16Snorm;
  }
  return spec.format;
}

double ScaleOf(const TargetSpec& spec, const BoundShader& shader) {
  return spec.scale ? *spec.scale : OwnScale(spec.format, *shader.info);
}

bool FillBit(const TargetSpec& spec) {
  return spec.fill_values.empty() || spec.fill_values[0] != 0;
}

bool HoldsOwner(const VoxelizeRequest& request, const TargetSpec& spec) {
  return FillsParts(request) && spec.blend == Blend::kReplace;
}

bool GivesValuesOfParts(const VoxelizeRequest& request, const TargetSpec& spec) {
  constexpr std::string_view kShaders[] = {"triangle_id", "material_id", "mesh_id",           "label",
                                           "base_color",  "emissive",    "metallic_roughness"};
  return FillsParts(request) &&
         std::find(std::begin(kShaders), std::end(kShaders), spec.shader.name) != std::end(kShaders);
}

bool HasFillValue(const VoxelizeRequest& request, const TargetSpec& spec, bool bodies_move) {
  if (spec.format == VoxelFormat::kBit || !spec.fill_values.empty() || spec.blend == Blend::kCount) return true;
  const std::string& shader = spec.shader.name;
  if (GivesValuesOfParts(request, spec) && shader != "triangle_id") return true;  // that of a lone triangle aside
  if (shader == "velocity") {
    const bool known = !bodies_move || (FillsParts(request) && request.parts.scope == PartScope::kFile);
    return known && !GivesVelocities(request.vertex_shader);
  }
  return shader == "occupancy" || shader == "constant" || shader == "position" || shader == "checker";
}

FillValue VelocityFillValue(const BoundRequest& request, size_t index, const GridSpec& grid) {
  FillValue fill = FillValueOf(request, index, grid);
  if (!GivesVelocities(request.request.vertex_shader)) SetMotion(request, fill);
  return fill;
}

FillValue FillValueOf(const BoundRequest& request, size_t index, const GridSpec& grid) {
  const TargetSpec& spec = request.request.targets[index];
  const BoundShader& shader = request.fragment_shaders[index];
  FillValue fill;
  fill.format = KeptFormat(spec);
  fill.scale = ScaleOf(spec, shader);
  fill.origin = grid.origin;
  fill.voxel_size = grid.voxel_size;
  if (spec.format == VoxelFormat::kBit) {
    fill.stored[0] = FillBit(spec);
    return fill;
  }
  if (!spec.fill_values.empty()) {
    for (size_t c = 0; c < 4; ++c) {
      StoreNumber(spec.fill_values[std::min(c, spec.fill_values.size() - 1)], spec, fill.stored[c]);
    }
    return fill;
  }
  if (spec.blend == Blend::kCount) return fill;
  const bool of_parts = GivesValuesOfParts(request.request, spec) ||
                        (request.bodies_move && FragmentShaderId(shader.id) == FragmentShaderId::kVelocity);
  if (of_parts || !HasFillValue(request.request, spec, request.bodies_move)) {
    for (uint32_t& stored : fill.stored) StoreNumber(spec.clear, spec, stored);
    return fill;
  }
  FragmentOutput out;
  switch (FragmentShaderId(shader.id)) {
    case FragmentShaderId::kOccupancy:
      OccupancyShader::Shade(FragmentInput(), shader.params, out);
      StoreOutput(out, fill);
      return fill;
    case FragmentShaderId::kConstant:
      ConstantShader::Shade(FragmentInput(), shader.params, out);
      StoreOutput(out, fill);
      return fill;
    case FragmentShaderId::kPosition: fill.kind = FillValue::Kind::kPosition; return fill;
    case FragmentShaderId::kChecker:
      fill.kind = FillValue::Kind::kChecker;
      std::copy_n(shader.params.value, 3, fill.parameters);
      return fill;
    case FragmentShaderId::kVelocity: SetMotion(request, fill); return fill;
    default: return fill;  // has no fill value
  }
}

}  // namespace voxelpipe
