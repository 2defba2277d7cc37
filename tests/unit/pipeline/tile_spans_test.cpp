// The rows of triangles in a tile, on every instruction set, against the one definition of coverage.
#include "cpu/tile_spans.h"

#include <random>

#include "cpu/row_kernels.h"
#include "gtest/gtest.h"
#include "support/meshes.h"

namespace voxelpipe::cpu {
namespace {

std::vector<const RowKernels*> VectorKernels() {
  std::vector<const RowKernels*> kernels;
  for (const SimdChoice choice : {SimdChoice::kAvx2, SimdChoice::kAvx512}) {
    if (const auto found = SelectRowKernels(choice); found.ok()) kernels.push_back(*found);
  }
  return kernels;
}

struct Spans {
  std::vector<std::vector<uint32_t>> of;  // triangle, span
  size_t total = 0;
};

Spans SpansBy(const RowKernels& kernels, const TriangleMesh& mesh, Coverage coverage, const VoxelRange& tile) {
  static_assert(sizeof(mesh.triangles[0]) == 3 * sizeof(uint32_t));
  const RowMesh rows =
      IndexSpaceMesh(mesh.positions.data(), reinterpret_cast<const uint32_t(*)[3]>(mesh.triangles.data()));
  Spans spans;
  std::vector<uint64_t> pairs;
  for (uint64_t t = 0; t < mesh.triangles.size(); ++t) pairs.push_back(uint64_t{7} << 32 | t);
  // Counts below, at and above a vector's lanes.
  for (size_t first = 0, count = 1; first < pairs.size(); first += count, count = count % 16 + 1) {
    TileSpans out;
    count = std::min(count, pairs.size() - first);
    kernels.spans_in_tile(rows, &pairs[first], int64_t(count), coverage, tile, out);
    for (size_t i = 0; i < count; ++i) {
      spans.of.emplace_back();
      for (int k = 0; k < out.count[i]; ++k) spans.of.back().push_back(out.spans[i][k].bits);
      spans.total += size_t(out.count[i]);
    }
  }
  return spans;
}

TEST(TileSpans, AreThoseOfTheDefinitionOnEveryInstructionSet) {
  const auto scalar = SelectRowKernels(SimdChoice::kScalar);
  ASSERT_TRUE(scalar.ok());
  const VoxelRange whole{{32, 8, 16}, {64, 16, 24}}, cut{{32, 8, 16}, {37, 15, 18}}, first{{0, 0, 0}, {32, 8, 8}};
  for (const double scale : {0.02, 0.3, 1.0, 4.0, 17.0, 90.0}) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      for (const VoxelRange& tile : {whole, cut, first}) {
        TriangleMesh mesh = testing::Soup(400, 1, 5);
        ASSERT_EQ(mesh.positions.size(), 3 * mesh.triangles.size());
        std::mt19937 random(3);
        std::uniform_real_distribution<double> place(-0.2, 1.2);
        for (const auto& triangle : mesh.triangles) {
          Vec3d at;
          for (int a = 0; a < 3; ++a) {
            at[a] = double(tile.begin[a]) + place(random) * double(tile.end[a] - tile.begin[a]);
          }
          for (const uint32_t v : triangle) mesh.positions[v] = mesh.positions[v] * scale + at;
        }
        const Spans expected = SpansBy(**scalar, mesh, coverage, tile);
        ASSERT_GT(expected.total, 20u);
        for (const RowKernels* kernels : VectorKernels()) {
          ASSERT_EQ(SpansBy(*kernels, mesh, coverage, tile).of, expected.of) << kernels->name << " at " << scale;
        }
      }
    }
  }
}

TEST(TileSpans, AreNoneOfTrianglesFarFromTheTile) {
  TriangleMesh mesh;
  for (const double x : {-0x1p40, -0x1p31, -0x1p20, 0x1p20, 0x1p31, 0x1p40}) {
    for (const int axis : {0, 1, 2}) {
      Vec3d at{10, 10, 10};
      at[axis] = x;
      const auto v = uint32_t(mesh.positions.size());
      for (const Vec3d& corner : {Vec3d{0, 0, 0}, Vec3d{2, 0, 1}, Vec3d{0, 3, 1}})
        mesh.positions.push_back(at + corner);
      mesh.triangles.push_back({v, v + 1, v + 2});
    }
  }
  std::vector<const RowKernels*> all = VectorKernels();
  all.push_back(*SelectRowKernels(SimdChoice::kScalar));
  for (const RowKernels* kernels : all) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      EXPECT_EQ(SpansBy(*kernels, mesh, coverage, {{0, 8, 8}, {32, 16, 16}}).total, 0u) << kernels->name;
    }
  }
}

}  // namespace
}  // namespace voxelpipe::cpu
