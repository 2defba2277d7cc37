// The value of a filled voxel without a fragment of the target: one definition for both devices.
//
// The default is the shader's output at the voxel's centre, if the shader needs no triangle, converted as `replace`
// converts a fragment's output.
#pragma once

#include "shaders/blend_ops.h"
#include "shaders/fragment/checker.h"
#include "shaders/interface/vertex.h"

namespace voxelpipe {

// Made by FillValueOf (pipeline/stages/target_rules.h).
struct FillValue {
  enum class Kind : uint8_t {
    kStored,         // the same in all voxels
    kPosition,       // the voxel's centre, world units
    kVelocity,       // of the rigid motion there
    kTwoVelocities,  // the same, and that of `further`
    kChecker,
  };
  Kind kind = Kind::kStored;
  VoxelFormat format = VoxelFormat::kBit;  // from KeptFormat
  double scale = 1;
  uint32_t stored[4] = {};  // kStored: one per component, as stored in the format
  // For the other kinds.
  Vec3d origin{}, voxel_size{1, 1, 1};
  double parameters[RigidMotion::kParameters] = {};  // of RigidMotion, or of CheckerShader
  double further[RigidMotion::kParameters] = {};     // kTwoVelocities: of a second RigidMotion
};

// The centre of a voxel, in world units.
VOXELPIPE_HD Vec3d VoxelCentre(const Vec3d& origin, const Vec3d& voxel_size, int64_t x, int64_t y, int64_t z) {
  return {origin.x + (double(x) + 0.5) * voxel_size.x, origin.y + (double(y) + 0.5) * voxel_size.y,
          origin.z + (double(z) + 0.5) * voxel_size.z};
}

// The shader's output at the centre of a voxel, given in grid coordinates. Not for kStored.
VOXELPIPE_HD FragmentOutput FillOutput(const FillValue& fill, int64_t x, int64_t y, int64_t z) {
  FragmentOutput out;
  if (fill.kind == FillValue::Kind::kChecker) {
    FragmentInput in;
    in.voxel[0] = x;
    in.voxel[1] = y;
    in.voxel[2] = z;
    ShaderParams params;
    for (int i = 0; i < 3; ++i) params.value[i] = fill.parameters[i];
    CheckerShader::Shade(in, params, out);
    return out;
  }
  Vec3d v = VoxelCentre(fill.origin, fill.voxel_size, x, y, z);
  if (fill.kind == FillValue::Kind::kVelocity) {
    v = RigidMotion::At(fill.parameters, v);
  } else if (fill.kind == FillValue::Kind::kTwoVelocities) {
    v = RigidMotion::At(fill.parameters, v) + RigidMotion::At(fill.further, v);
  }
  for (int i = 0; i < 3; ++i) out.f[i] = float(v[i]);
  return out;
}

// Component c of a filled voxel, given in grid coordinates, as stored in the format.
VOXELPIPE_HD uint32_t FillStored(const FillValue& fill, int64_t x, int64_t y, int64_t z, int c) {
  if (fill.kind == FillValue::Kind::kStored) return fill.stored[c];
  const FragmentOutput out = FillOutput(fill, x, y, z);
  return StoredBits(ToCell(out, false, c, fill.format, fill.scale), fill.format);
}

}  // namespace voxelpipe
