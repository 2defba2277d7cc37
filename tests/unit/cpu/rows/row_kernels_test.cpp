// The vector kernels against the plain ones, where they take other steps to the same result.
#include "cpu/rows/row_kernels.h"

#include <bit>
#include <cmath>
#include <random>
#include <vector>

#include "grid/index_space.h"
#include "gtest/gtest.h"

namespace voxelpipe::cpu {
namespace {

std::vector<const RowKernels*> Available() {
  std::vector<const RowKernels*> kernels;
  for (const SimdChoice choice : {SimdChoice::kScalar, SimdChoice::kAvx2, SimdChoice::kAvx512}) {
    if (const auto found = SelectRowKernels(choice); found.ok()) kernels.push_back(*found);
  }
  return kernels;
}

void ExpectPlaces(const std::vector<Vec3d>& world, const IndexSpace& space) {
  const RowKernels& plain = **SelectRowKernels(SimdChoice::kScalar);
  std::vector<VertexCode> codes(world.size()), expected_codes(world.size());
  std::vector<Vec3d> index(world.size());
  const auto count = int64_t(world.size());
  plain.place(world.data(), 0, count, space, nullptr, expected_codes.data());
  for (const RowKernels* kernels : Available()) {
    kernels->place(world.data(), 0, count, space, index.data(), codes.data());
    for (size_t i = 0; i < world.size(); ++i) {
      const Vec3d expected = WorldToIndex(space, world[i]);
      for (int a = 0; a < 3; ++a) {
        ASSERT_EQ(std::bit_cast<uint64_t>(index[i][a]), std::bit_cast<uint64_t>(expected[a]))
            << kernels->name << ": (" << world[i][a] << " - " << space.origin[a] << ") / " << space.voxel_size[a];
        ASSERT_EQ(codes[i].axis[a], expected_codes[i].axis[a]) << kernels->name << ", index " << expected[a];
      }
      ASSERT_EQ(codes[i].axis[3], 0);
    }
  }
}

void ExpectRoundedQuotients(const std::vector<Vec3d>& world, const Vec3d& origin, const Vec3d& voxel_size) {
  ExpectPlaces(world, {origin, voxel_size});
}

std::vector<Vec3d> RandomPoints(std::mt19937_64& random, size_t count, double reach) {
  std::uniform_real_distribution<double> coordinate(-reach, reach);
  std::vector<Vec3d> points;
  for (size_t i = 0; i < count; ++i) points.push_back({coordinate(random), coordinate(random), coordinate(random)});
  return points;
}

TEST(RowKernels, PlaceDividesAsTheProcessorDoes) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> mantissa(1, 2);
  for (int i = 0; i < 300; ++i) {
    const Vec3d size{std::ldexp(mantissa(random), i % 60 - 40), std::ldexp(mantissa(random), -i % 9),
                     std::ldexp(mantissa(random), i % 5)};
    ExpectRoundedQuotients(RandomPoints(random, 1003, std::ldexp(100.0, i % 40 - 20)), {0.1 * i, -7, 1e-9}, size);
  }
}

TEST(RowKernels, PlaceTakesWhatLiesBeyondWallsToThem) {
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> share(-1, 1);
  IndexSpace space{{0.125, -2, 1e3}, {0.1, 0.25, 3}};
  space.wall = {10, IndexSpace::kNoWall, 7};
  space.wall_end = {10 + 4e-4, IndexSpace::kNoWall, 7 + 1e-9};
  std::vector<Vec3d> world;
  for (int i = 0; i < 3001; ++i) {
    const double near = i % 3 == 0 ? 1e-3 : i % 3 == 1 ? 2e-9 : 4;
    const Vec3d at{10 + near * share(random), 10 + share(random), 7 + near * share(random)};
    world.push_back({space.origin.x + at.x * space.voxel_size.x, space.origin.y + at.y * space.voxel_size.y,
                     space.origin.z + at.z * space.voxel_size.z});
  }
  ExpectPlaces(world, space);
  int moved = 0;
  for (const Vec3d& p : world) moved += WorldToIndex(space, p).x == 10 || WorldToIndex(space, p).z == 7;
  EXPECT_GT(moved, 300);
}

// Whole and half quotients, where a last place decides.
TEST(RowKernels, PlaceDividesMultiplesOfTheVoxelSize) {
  std::mt19937_64 random(4);
  for (const double h : {0.1, 1.0 / 3, 3.0, 0x1.fffffffffffffp0, 0x1.ffffffffffffep-3, 0x1.0000000000001p2, 1e-3}) {
    std::vector<Vec3d> points;
    for (int i = -400; i < 400; ++i) {
      points.push_back({i * h, (i + 0.5) * h, std::nextafter(i * h, 1e9)});
      points.push_back({i * h + h * kNarrowWidening, i * h - h * kNarrowWidening, std::nextafter((i + 0.5) * h, -1e9)});
    }
    ExpectRoundedQuotients(points, {0, 0, 0}, {h, h, h});
  }
}

TEST(RowKernels, PlaceKeepsZerosTheTinyAndTheHuge) {
  const double denormal = 0x1p-1060;
  std::vector<Vec3d> points;
  for (const double v :
       {0.0, -0.0, denormal, -denormal, 0x1p-700, 0x1p-251, 0x1p-250, 1e-90, 1.0, 1e90, 0x1p250, 0x1p251})
    points.push_back({v, -v, v * 3});
  for (const double h : {1.0, 0.3, 1e-200, 0x1p-250, 0x1p-251, 0x1p250, 0x1p251, 1e200, 0x1p-1050}) {
    ExpectRoundedQuotients(points, {0, 0, 0}, {h, h, h});
    for (const Vec3d& p : points) ExpectRoundedQuotients({p}, {0, -0.0, 0}, {h, 1, h});
  }
}

TEST(RowKernels, PlaceSaysWhatIsTooFarOrIrregular) {
  const auto place = [](const RowKernels& kernels, double v, double h) {
    const std::vector<Vec3d> world(19, Vec3d{1, v, 1});
    std::vector<VertexCode> codes(world.size());
    return kernels.place(world.data(), 0, 19, IndexSpace{{0, 0, 0}, {1, h, 1}}, nullptr, codes.data());
  };
  for (const RowKernels* kernels : Available()) {
    EXPECT_TRUE(place(*kernels, 0x1p40, 1).near);
    EXPECT_FALSE(place(*kernels, 0x1.1p40, 1).near);
    EXPECT_FALSE(place(*kernels, -0x1.1p40, 1).near);
    EXPECT_TRUE(place(*kernels, 0, 1).regular);
    EXPECT_TRUE(place(*kernels, 0.3, 0.1).regular);
    if (kernels->name == "scalar") continue;  // divides always
    EXPECT_FALSE(place(*kernels, 0x1p-300, 1).regular);
    EXPECT_FALSE(place(*kernels, 1, 0x1.fffffffffffffp0).regular);
  }
}

}  // namespace
}  // namespace voxelpipe::cpu
