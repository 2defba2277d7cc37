// What a target's specification means to the stages of every backend.
#pragma once

#include "grid/grid_spec.h"
#include "pipeline/stages/stages.h"
#include "shaders/fill_value.h"

namespace voxelpipe {

// The format that values are converted to and blended in: the one of its encoding, otherwise the target's own.
VoxelFormat KeptFormat(const TargetSpec& spec);

// The factor of f32 outputs into integers: that of the request; without one colours fill the range of 8 and 16 bits.
double ScaleOf(const TargetSpec& spec, const BoundShader& shader);

// Of a bit target: what its filled voxels without a fragment hold.
bool FillBit(const TargetSpec& spec);

// True if parts are filled and the target's shader reads only what a whole part may have in common: ids, labels,
// parameters and factors of materials. What each part has is in part_fill_values.h.
bool GivesValuesOfParts(const VoxelizeRequest& request, const TargetSpec& spec);

// True if voxels hold the fragment of their owner alone: `replace` where parts are filled.
bool HoldsOwner(const VoxelizeRequest& request, const TargetSpec& spec);

// False if filled voxels without a fragment hold the target's `clear`: the request gives them no value, and the shader
// has none without a triangle. `bodies_move`: placed meshes have motions of their own, so that a place has none.
bool HasFillValue(const VoxelizeRequest& request, const TargetSpec& spec, bool bodies_move);

// Of a target of velocities: the motion of the vertex shader at the voxel's centre, whatever bodies move, or `clear`
// where the vertex shader itself gives velocities.
FillValue VelocityFillValue(const BoundRequest& request, size_t index, const GridSpec& grid);

// What filled voxels without a fragment hold of the request's target number `index`.
FillValue FillValueOf(const BoundRequest& request, size_t index, const GridSpec& grid);

}  // namespace voxelpipe
