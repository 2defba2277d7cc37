// Short ways to run the pipeline in a test and to read its results.
#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "gtest/gtest.h"
#include "pipeline/voxelize.h"

namespace voxelpipe::testing {

// Runs on the calling machine's CPU and fails the test on an error.
inline VoxelizeResult RunPipeline(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  const JobContext job;
  auto result = Voxelize(mesh, request, {job});
  EXPECT_TRUE(result.ok()) << result.status();
  if (!result.ok()) return {};
  return *std::move(result);
}

// A hook that keeps the plan of a run.
inline PlanHook KeepPlan(Plan& to) {
  return [&to](const Plan& plan) {
    to = plan;
    return absl::OkStatus();
  };
}

// A hook that counts how often it is called.
inline PlanHook CountPlans(int& plans) {
  return [&plans](const Plan&) {
    ++plans;
    return absl::OkStatus();
  };
}

inline absl::Status RunError(const TriangleMesh& mesh, const VoxelizeRequest& request, const PlanLimits& limits = {}) {
  const JobContext job;
  return Voxelize(mesh, request, {job, limits}).status();
}

using Arrays = std::vector<std::vector<uint8_t>>;

// Copies of the arrays of a result, in stream order.
inline Arrays CopyArrays(const VoxelizeResult& result) {
  Arrays arrays;
  for (const auto& bytes : ArraysOf(result)) arrays.emplace_back(bytes.begin(), bytes.end());
  return arrays;
}

// Keeps the arrays of a streamed result.
class KeepArrays final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader& header) override {
    arrays.resize(header.arrays.size());
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    arrays.at(array).insert(arrays[array].end(), bytes.begin(), bytes.end());
    return absl::OkStatus();
  }
  Arrays arrays;
};

inline bool BitAt(const HostBuffer& bits, uint64_t n) {
  return (bits.data()[n / 8] >> (n % 8)) & 1;
}
inline float FloatAt(const HostBuffer& values, uint64_t i) {
  return reinterpret_cast<const float*>(values.data())[i];
}
template <typename T>
T ValueAt(const HostBuffer& values, uint64_t i) {
  T value;
  std::memcpy(&value, values.data() + i * sizeof(T), sizeof(T));
  return value;
}

inline std::vector<uint8_t> Bytes(const HostBuffer& buffer) {
  return {buffer.bytes().begin(), buffer.bytes().end()};
}

// Index space is world space: voxel size 1, origin 0.
inline GridRequest UnitGrid(int64_t nx, int64_t ny, int64_t nz) {
  GridRequest grid;
  grid.dims = {nx, ny, nz};
  grid.origin = Vec3d{0, 0, 0};
  grid.voxel_size = Vec3d{1, 1, 1};
  return grid;
}

inline TargetSpec FloatTarget(int components, Blend blend, ShaderCall shader) {
  TargetSpec target;
  target.format = VoxelFormat::kF32;
  target.components = components;
  target.blend = blend;
  target.shader = std::move(shader);
  return target;
}
inline TargetSpec TargetOf(VoxelFormat format, int components, Blend blend, ShaderCall shader) {
  TargetSpec target = FloatTarget(components, blend, std::move(shader));
  target.format = format;
  return target;
}

}  // namespace voxelpipe::testing
