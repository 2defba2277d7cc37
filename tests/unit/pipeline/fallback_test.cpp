// Where `auto` takes a GPU that fails, the CPU does the job. A process of its own: its device stands in for a GPU in
// all of it.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "support/faulty_backend.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe::testing {
namespace {

FaultyBackend& Device() {
  static auto* const device = [] {
    auto* const made = new FaultyBackend;
    RegisterDevice(made);
    return made;
  }();
  return *device;
}

// The next run fails on the device.
void Break(const std::string& kind, const std::string& stage, int slab = 0) {
  Fault fault;
  fault.kind = kind;
  fault.stage = stage;
  fault.slab = slab;
  Device().Set(fault);
}

VoxelizeRequest Request(BackendChoice backend) {
  VoxelizeRequest request;
  request.grid = UnitGrid(40, 40, 40);
  request.targets = {TargetSpec{}, FloatTarget(3, Blend::kAdd, {"geometric_normal", {}})};
  request.backend = backend;
  return request;
}

class CountingSink final : public ResultSink {
 public:
  explicit CountingSink(bool keep = false) : keeps_(keep) {}

  bool Keep(VoxelizeResult&& whole) override {
    if (!keeps_) return false;
    for (const std::span<const uint8_t> array : ArraysOf(whole)) arrays.emplace_back(array.begin(), array.end());
    ++keeps;
    return true;
  }
  absl::Status Begin(const ResultHeader& header) override {
    ++begins;
    arrays.resize(header.arrays.size());
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    arrays.at(array).insert(arrays[array].end(), bytes.begin(), bytes.end());
    return ++writes == fail_at ? absl::DataLossError("the disk is full") : absl::OkStatus();
  }

  std::vector<std::vector<uint8_t>> arrays;
  int keeps = 0, begins = 0, writes = 0, fail_at = -1;

 private:
  bool keeps_;
};

class Fallback : public ::testing::Test {
 protected:
  const TriangleMesh mesh_ = Soup(200, 40, 3);
  const JobContext job_;
};

TEST_F(Fallback, TheCpuDoesWhatTheDeviceCannot) {
  const VoxelizeRequest request = Request(BackendChoice::kAuto);
  Device().Set({});
  const absl::StatusOr<VoxelizeResult> whole = Voxelize(mesh_, request, {job_});
  ASSERT_TRUE(whole.ok()) << whole.status();
  EXPECT_EQ(whole->stats.backend, "cuda");
  for (const char* kind : {"memory", "error", "lost"}) {
    for (const char* stage : {"start", "vertex_shade", "begin_slab", "fine_raster", "finish"}) {
      Break(kind, stage);
      int plans = 0;
      const absl::StatusOr<VoxelizeResult> result =
          Voxelize(mesh_, request, {.job = job_, .on_plan = CountPlans(plans)});
      ASSERT_TRUE(result.ok()) << kind << " in " << stage << ": " << result.status();
      EXPECT_EQ(result->stats.backend, "cpu") << kind << " in " << stage;
      EXPECT_EQ(result->stats.device_failure, absl::StrCat("cuda:0: a fault was asked for in ", stage));
      EXPECT_EQ(result->stats.occupied, whole->stats.occupied);
      EXPECT_EQ(plans, 1) << kind << " in " << stage;
      for (size_t t = 0; t < 2; ++t) EXPECT_EQ(Bytes(result->targets[t]), Bytes(whole->targets[t]));
    }
  }
}

TEST_F(Fallback, AStreamGoesOnWhereItWasCutOff) {
  const VoxelizeRequest request = Request(BackendChoice::kAuto);
  PlanLimits limits;
  limits.slab_depth = 8;
  Device().Set({});
  CountingSink whole;
  ASSERT_TRUE(VoxelizeTo(mesh_, request, {job_, limits}, whole).ok());
  ASSERT_EQ(whole.writes, 10);  // of two targets five slabs each
  for (const char* stage : {"vertex_shade", "begin_slab", "finish"}) {
    for (const int slab : {0, 1, 4, 7}) {
      if (std::string(stage) == "vertex_shade" && slab > 0) continue;
      Break("error", stage, slab);
      CountingSink sink;
      int plans = 0;
      const absl::StatusOr<VoxelizeStats> stats = VoxelizeTo(mesh_, request, {job_, limits, CountPlans(plans)}, sink);
      ASSERT_TRUE(stats.ok()) << stage << ", slab " << slab << ": " << stats.status();
      EXPECT_EQ(stats->backend, "cpu");
      EXPECT_EQ(sink.begins, 1) << stage << ", slab " << slab;
      EXPECT_EQ(sink.writes, whole.writes) << stage << ", slab " << slab;
      EXPECT_EQ(sink.arrays, whole.arrays) << stage << ", slab " << slab;
      EXPECT_EQ(plans, 1);
    }
  }
}

TEST_F(Fallback, EveryKindOfResultIsHandedOnWhole) {
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
      for (const bool keeps : {false, true}) {
        for (const int64_t depth : {8, 40}) {
          VoxelizeRequest request = Request(BackendChoice::kAuto);
          request.result = kind;
          request.layout = layout;
          if (kind == ResultKind::kBuckets) request.targets[1].blend = Blend::kReplace;
          PlanLimits limits;
          limits.slab_depth = depth;
          Device().Set({});
          CountingSink whole(keeps);
          const absl::StatusOr<VoxelizeStats> expected = VoxelizeTo(mesh_, request, {job_, limits}, whole);
          ASSERT_TRUE(expected.ok()) << expected.status();
          EXPECT_EQ(expected->device_failure, "");
          Break("memory", "finish", depth == 8 ? 1 : 0);
          CountingSink sink(keeps);
          const absl::StatusOr<VoxelizeStats> stats = VoxelizeTo(mesh_, request, {job_, limits}, sink);
          ASSERT_TRUE(stats.ok()) << stats.status();
          EXPECT_EQ(stats->backend, "cpu");
          EXPECT_EQ(sink.arrays, whole.arrays);
          EXPECT_EQ(sink.keeps, whole.keeps);
          EXPECT_EQ(sink.begins, whole.begins);
        }
      }
    }
  }
}

TEST_F(Fallback, AnErrorOfBothNamesBoth) {
  Break("memory", "vertex_shade");
  CountingSink sink;
  sink.fail_at = 1;
  const absl::Status status = VoxelizeTo(mesh_, Request(BackendChoice::kAuto), {job_}, sink).status();
  EXPECT_EQ(status,
            absl::DataLossError("the disk is full; tried before, cuda:0: a fault was asked for in vertex_shade"));
}

TEST_F(Fallback, WhoAsksForTheGpuIsToldOfIt) {
  Break("memory", "vertex_shade");
  const absl::StatusOr<VoxelizeResult> result = Voxelize(mesh_, Request(BackendChoice::kCuda), {job_});
  EXPECT_EQ(result.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(DeviceFailureOf(result.status()), DeviceFailureKind::kOutOfMemory);
}

TEST_F(Fallback, WhatIsNotTheDevicesFaultIsNotTriedAgain) {
  Device().Set({});
  VoxelizeRequest request = Request(BackendChoice::kAuto);
  request.grid = UnitGrid(100000, 100000, 100000);
  const int runs = Device().runs();
  PlanLimits limits;
  EXPECT_EQ(Voxelize(mesh_, request, {job_, limits}).status().code(), absl::StatusCode::kResourceExhausted);
  CountingSink sink;
  sink.fail_at = 3;
  limits.slab_depth = 8;
  const auto stats = VoxelizeTo(mesh_, Request(BackendChoice::kAuto), {job_, limits}, sink);
  EXPECT_EQ(stats.status(), absl::DataLossError("the disk is full"));
  EXPECT_EQ(sink.writes, 3);
  EXPECT_LE(Device().runs(), runs + 2);
}

}  // namespace
}  // namespace voxelpipe::testing
