// The path of each kind of request, by its name, without a device.
#include "cuda/plan/path_plan.h"

#include "cuda/primitives/span.h"
#include "gtest/gtest.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint64_t kFine = 1000;

PathTarget Floats(Blend blend, int components = 1) {
  PathTarget target;
  target.format = VoxelFormat::kF32;
  target.blend = blend;
  target.components = components;
  return target;
}
PathTarget Flat(Blend blend, int components = 1) {
  PathTarget target = Floats(blend, components);
  target.same_for_triangle = true;
  return target;
}
PathTarget Bit() {
  PathTarget target;
  target.is_occupancy = true;
  return target;
}

PathInputs Inputs(std::initializer_list<PathTarget> targets, ResultKind result = ResultKind::kDense) {
  PathInputs in;
  in.result = result;
  for (const PathTarget& target : targets) in.targets[size_t(in.target_count++)] = target;
  in.triangles = 100;
  in.fine_triangles = kFine;
  return in;
}

std::string NameOf(const PathInputs& in, int target = 0) {
  return PathName(PlanPath(in), target);
}

TEST(PathPlanTest, OccupancyBitsAreSetByRows) {
  EXPECT_EQ(NameOf(Inputs({Bit()})), "occupancy");
  EXPECT_EQ(NameOf(Inputs({Bit(), Bit()}, ResultKind::kSparse)), "occupancy");
}

TEST(PathPlanTest, OccupancyBitsOfGridsThatRowsDoNotFitAreTheCoverage) {
  PathInputs in = Inputs({Bit()});
  in.rows_fit = false;
  EXPECT_EQ(PlanPath(in).path, Path::kAccumulators);
  EXPECT_EQ(NameOf(in), "coverage");
}

TEST(PathPlanTest, NothingIsCoveredWithoutCoverage) {
  PathInputs in = Inputs({Floats(Blend::kMax)});
  in.coverage = Coverage::kNone;
  EXPECT_EQ(NameOf(in), "nothing");
}

TEST(PathPlanTest, ABuffersAreListsOfFragments) {
  EXPECT_EQ(NameOf(Inputs({Floats(Blend::kReplace)}, ResultKind::kBuckets)), "fragment list");
}

TEST(PathPlanTest, OneLargestValueATriangleIsBlendedWhereTheTargetLies) {
  EXPECT_EQ(NameOf(Inputs({Flat(Blend::kMax)})), "triangles in place");
  EXPECT_EQ(NameOf(Inputs({Flat(Blend::kMin)})), "triangles in place");
  EXPECT_EQ(NameOf(Inputs({Bit(), Flat(Blend::kMax)}), 1), "triangles in place");
}

TEST(PathPlanTest, WhatClearsToAnotherValueHasAccumulators) {
  PathInputs in = Inputs({Flat(Blend::kMax)});
  in.targets[0].clears_to_zero = false;
  EXPECT_EQ(NameOf(in), "triangles in accumulators");
}

TEST(PathPlanTest, FourFloatsOfFineMeshesHaveAPathOfTheirOwn) {
  PathInputs in = Inputs({Flat(Blend::kMax, 4)});
  EXPECT_EQ(NameOf(in), "triangles in place, by records");
  in.triangles = kFine;
  EXPECT_EQ(NameOf(in), "triangles in place, float4");
  in.planar = true;
  EXPECT_EQ(NameOf(in), "triangles in place, by records");
  in.planar = false;
  in.fixed_point = false;
  EXPECT_EQ(NameOf(in), "triangles in place, by records");
}

TEST(PathPlanTest, SparseLargestFloatsAreBlendedInBricks) {
  EXPECT_EQ(NameOf(Inputs({Flat(Blend::kMax)}, ResultKind::kSparse)), "triangles in bricks");
  EXPECT_EQ(NameOf(Inputs({Flat(Blend::kAdd)}, ResultKind::kSparse)), "triangles in accumulators");
  EXPECT_EQ(NameOf(Inputs({Flat(Blend::kMax), Bit()}, ResultKind::kSparse)), "triangles in accumulators");
}

TEST(PathPlanTest, OwnersAreFoundInBricks) {
  for (const ResultKind result : {ResultKind::kDense, ResultKind::kSparse}) {
    EXPECT_EQ(NameOf(Inputs({Floats(Blend::kReplace, 3)}, result)), "owners in bricks");
    EXPECT_EQ(NameOf(Inputs({Flat(Blend::kFirst)}, result)), "owners in bricks");
  }
}

TEST(PathPlanTest, OwnersOfBitsOfFilledGridsAndOfSeveralTargetsAreFoundInAccumulators) {
  PathTarget bit;
  bit.blend = Blend::kReplace;
  EXPECT_EQ(NameOf(Inputs({bit})), "owners in accumulators");
  PathInputs filled = Inputs({Floats(Blend::kReplace)});
  filled.fill = Fill::kParity;
  EXPECT_EQ(NameOf(filled), "owners in accumulators");
  const PathInputs several = Inputs({Floats(Blend::kReplace), Floats(Blend::kAverage, 3)});
  EXPECT_EQ(NameOf(several, 0), "owners in accumulators");
  EXPECT_EQ(NameOf(several, 1), "fragments in accumulators");
}

TEST(PathPlanTest, OwnersOfFilledPartsAreFoundInAccumulators) {
  for (const ResultKind result : {ResultKind::kDense, ResultKind::kSparse}) {
    PathInputs in = Inputs({Bit(), Floats(Blend::kReplace), Flat(Blend::kMax), Floats(Blend::kAdd)}, result);
    in.fill = Fill::kNonzero;
    in.by_parts = true;
    EXPECT_EQ(PlanPath(in).path, Path::kAccumulators);
    EXPECT_EQ(NameOf(in, 0), "coverage, by parts");
    EXPECT_EQ(NameOf(in, 1), "owners in accumulators, by parts");
    const bool dense = result == ResultKind::kDense;
    EXPECT_EQ(NameOf(in, 2),
              dense ? "triangles in place, by records, by parts" : "triangles in accumulators, by parts");
    EXPECT_EQ(NameOf(in, 3), "fragments in accumulators, by parts");
    in.coverage = Coverage::kNone;
    EXPECT_EQ(NameOf(in, 1), "nothing, by parts");
  }
  PathInputs alone = Inputs({Bit()});  // neither rows of bits nor in place: who owns a voxel is counted
  alone.by_parts = true;
  EXPECT_EQ(NameOf(alone), "coverage, by parts");
  alone.targets[0] = Flat(Blend::kMax);
  EXPECT_EQ(NameOf(alone), "triangles in place, by records, by parts");
}

TEST(PathPlanTest, FragmentsThatMayBeDiscardedAreShadedWhateverTheBlend) {
  for (const Blend blend : {Blend::kReplace, Blend::kMax, Blend::kCount}) {
    PathInputs in = Inputs({Flat(blend)});
    in.targets[0].may_discard = true;
    EXPECT_EQ(NameOf(in), "fragments in accumulators");
  }
}

TEST(PathPlanTest, AFullPoolOfBricksLeavesAccumulators) {
  const PathInputs in = Inputs({Floats(Blend::kReplace)}, ResultKind::kSparse);
  PathPlan plan = PlanPath(in);
  GoWithoutBricks(in, plan);
  EXPECT_EQ(PathName(plan, 0), "owners in accumulators");
}

TEST(MaxSlabLayersTest, AreAsManyEightsOfLayersAsSpansHaveNumbersFor) {
  EXPECT_EQ(MaxSlabLayers({2048, 2048, 2048}, kMaxSpanBits), 1016);  // 1024 have one bit too many
  EXPECT_EQ(MaxSlabLayers({33, 64, 64}, 64 * 64 * 16), 16);          // rows are whole words
  EXPECT_EQ(MaxSlabLayers({64, 64, 64}, 1), 8);
}

}  // namespace
}  // namespace voxelpipe::cuda
