#include "gpu/batch_cases.h"

#include <array>
#include <utility>

namespace voxelpipe::gpu {
namespace {

TargetSpec Target(VoxelFormat format, int components, const char* shader) {
  TargetSpec target;
  target.format = format;
  target.components = components;
  target.blend = format == VoxelFormat::kBit ? Blend::kOr : Blend::kMax;
  target.shader = {shader, {}};
  return target;
}

// Which one matters only where several share a pass: offsets of one's values depend on those before it.
std::vector<std::vector<TargetSpec>> TargetLists() {
  const TargetSpec bit;
  TargetSpec masked = Target(VoxelFormat::kU8, 3, "base_color");
  masked.clear = 7;
  TargetSpec set_where_masked = Target(VoxelFormat::kBit, 1, "emissive");
  set_where_masked.clear = 1;
  return {
      {bit},
      {Target(VoxelFormat::kU32, 1, "triangle_id")},
      {masked, Target(VoxelFormat::kF16, 2, "metallic_roughness"),
       set_where_masked},  // fragments that all discard are none
      {bit, masked, Target(VoxelFormat::kU16, 1, "packed_normal")},
      {Target(VoxelFormat::kBit, 1, "base_color")},
      {Target(VoxelFormat::kF32, 4, "normal"), Target(VoxelFormat::kF32, 3, "position")},
      {bit, bit},
      {Target(VoxelFormat::kU8, 1, "occupancy")},
      {Target(VoxelFormat::kBit, 1, "checker"), set_where_masked, Target(VoxelFormat::kF16, 1, "coverage_fraction")},
  };
}

}  // namespace

std::vector<ParityCase> ABufferCases() {
  constexpr std::array<int64_t, 3> kDims[] = {{40, 40, 40}, {1, 1, 1}, {33, 9, 7}, {31, 17, 41}, {1, 40, 1}};
  std::vector<ParityCase> cases;
  size_t number = 0;
  for (const std::vector<TargetSpec>& targets : TargetLists()) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
      VoxelizeRequest& request = cases.emplace_back().request;
      request.result = ResultKind::kBuckets;
      request.coverage = coverage;
      request.layout = Layout(number / 2 % 2);
      request.targets = targets;
      const std::array<int64_t, 3>& dims = kDims[number % std::size(kDims)];
      request.grid.dims = dims;
      request.grid.origin = Vec3d{0, 0, 0};
      request.grid.voxel_size = dims[0] == 1 && dims[1] == 1 ? Vec3d{40, 40, 40} : Vec3d{1, 1, 1};
      ++number;
    }
  }
  cases.push_back(cases.front());
  cases.back().request.coverage = Coverage::kCenter;
  return cases;
}

VoxelizeRequest FittedABuffer(int64_t resolution, bool shaded) {
  VoxelizeRequest request;
  request.result = ResultKind::kBuckets;
  request.grid.resolution = resolution;
  request.grid.fit = GridFit::kCube;
  if (shaded) request.targets[0] = Target(VoxelFormat::kF32, 3, "position");
  return request;
}

}  // namespace voxelpipe::gpu
