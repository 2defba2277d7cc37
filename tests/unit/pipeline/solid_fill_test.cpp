// The parity and nonzero fills against the definition: every triangle against every line.
#include <algorithm>
#include <cmath>

#include "cpu/rows/row_kernels.h"
#include "gtest/gtest.h"
#include "raster/crossing.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

struct Filled {
  std::vector<bool> inside;
  uint64_t odd_columns = 0;
};

// The sum over the edges that the line crosses, +1 where y rises along the edge.
int SignByDefinition(const Vec3d& a, const Vec3d& b, const Vec3d& c, double py, double pz) {
  int sum = 0;
  if (EdgeCrossesAbove(a, b, py, pz)) sum += b.y > a.y ? 1 : -1;
  if (EdgeCrossesAbove(b, c, py, pz)) sum += c.y > b.y ? 1 : -1;
  if (EdgeCrossesAbove(c, a, py, pz)) sum += a.y > c.y ? 1 : -1;
  return sum;
}

// Positions are in index space.
Filled FillByDefinition(const TriangleMesh& mesh, const std::array<int64_t, 3>& dims, Fill fill) {
  Filled filled;
  std::vector<int> sums(size_t(dims[0] * dims[1] * dims[2]));  // of what is crossed beyond each voxel
  std::vector<int> totals(size_t(dims[1] * dims[2]));
  const auto is_inside = [fill](int sum) { return fill == Fill::kNonzero ? sum != 0 : sum % 2 != 0; };
  for (const auto& t : mesh.triangles) {
    const Vec3d &a = mesh.positions[t[0]], &b = mesh.positions[t[1]], &c = mesh.positions[t[2]];
    const TrianglePlane plane = SetUpPlane(a, b, c);
    for (int64_t z = 0; z < dims[2]; ++z) {
      if (Max(a.z, Max(b.z, c.z)) < double(z) - 1 || Min(a.z, Min(b.z, c.z)) > double(z) + 2) continue;
      for (int64_t y = 0; y < dims[1]; ++y) {
        const double py = double(y) + 0.5, pz = double(z) + 0.5;
        if (!LineCrosses(a, b, c, py, pz)) continue;
        const size_t line = size_t(y + dims[1] * z);
        const int sign = fill == Fill::kNonzero ? SignByDefinition(a, b, c, py, pz) : 1;
        EXPECT_EQ(std::abs(sign), 1);
        totals[line] += sign;
        const int64_t before = CentresBefore(CrossingX(plane, a, b, c, py, pz), dims[0]);
        for (int64_t x = 0; x < before; ++x) sums[line * size_t(dims[0]) + size_t(x)] += sign;
      }
    }
  }
  for (const int sum : sums) filled.inside.push_back(is_inside(sum));
  filled.odd_columns = uint64_t(std::count_if(totals.begin(), totals.end(), is_inside));
  return filled;
}

void ExpectTheDefinition(const TriangleMesh& mesh, const std::array<int64_t, 3>& dims, Fill fill, Coverage coverage) {
  const Filled expected = FillByDefinition(mesh, dims, fill);
  VoxelizeRequest request;
  request.grid = UnitGrid(dims[0], dims[1], dims[2]);
  std::vector<uint8_t> covered((expected.inside.size() + 7) / 8);
  if (coverage != Coverage::kNone) covered = Bytes(RunPipeline(mesh, request).targets[0]);
  request.coverage = coverage;
  request.fill = fill;
  for (const SimdChoice simd : {SimdChoice::kScalar, SimdChoice::kAvx2, SimdChoice::kAvx512}) {
    if (!cpu::SelectRowKernels(simd).ok()) continue;
    request.simd = simd;
    // A filled voxel that is not covered: 1 in the first target, where clear ones are 0; the other way round in the
    // second.
    for (const size_t targets : {size_t{1}, size_t{2}}) {
      request.targets.assign(targets, TargetSpec{});
      if (targets == 2) request.targets[1].clear = 1, request.targets[1].fill_values = {0};
      const VoxelizeResult result = RunPipeline(mesh, request);
      EXPECT_EQ(result.stats.odd_columns, expected.odd_columns);
      std::vector<std::vector<uint8_t>> bytes;
      for (size_t t = 0; t < targets; ++t) bytes.push_back(Bytes(result.targets[t]));
      size_t wrong = 0;
      for (size_t n = 0; n < expected.inside.size(); ++n) {
        const bool here = (covered[n / 8] >> (n % 8) & 1) != 0, inside = expected.inside[n];
        wrong += ((bytes[0][n / 8] >> (n % 8) & 1) != 0) != (here || inside);
        if (targets == 2) wrong += ((bytes[1][n / 8] >> (n % 8) & 1) != 0) != (here || !inside);
      }
      EXPECT_EQ(wrong, 0u) << Name(simd) << ", " << targets << " targets";
      if (coverage == Coverage::kNone) {
        EXPECT_EQ(result.stats.fragments, 0u);
      }
    }
  }
}

void ExpectTheDefinition(const TriangleMesh& mesh, const std::array<int64_t, 3>& dims) {
  for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kNone}) {
      SCOPED_TRACE(std::string(Name(fill)) + " " + std::string(Name(coverage)));
      ExpectTheDefinition(mesh, dims, fill, coverage);
    }
  }
}

// Small and large triangles, slivers, points, ones on the planes of the lines and ones before, beyond and beside the
// grid.
TEST(SolidFill, IsTheDefinitionOnSoups) {
  for (const std::array<int64_t, 3>& dims :
       {std::array<int64_t, 3>{40, 33, 35}, {1, 20, 9}, {600, 3, 5}, {31, 1, 40}, {64, 17, 1}}) {
    ExpectTheDefinition(Soup(700, 40, uint32_t(dims[0])), dims);
  }
}

// Vertices and edges exactly on the lines, where a rounding in one triangle and not in its neighbour would show.
TEST(SolidFill, IsTheDefinitionOnVerticesAtCentres) {
  TriangleMesh mesh = Soup(900, 36, 3);
  for (Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) p[i] = std::floor(p[i] * 2) / 2;
  }
  ExpectTheDefinition(mesh, {36, 34, 32});
}

// Rows in several blocks, which end in the middle of a layer; triangles that lie in many of them.
TEST(SolidFill, IsTheDefinitionAcrossBlocksOfRows) {
  ExpectTheDefinition(Soup(150, 190, 8), {180, 170, 130});
}

}  // namespace
}  // namespace voxelpipe
