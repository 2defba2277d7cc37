// Boxes of triangles among tiles and their rows in a tile, on every instruction set, against the one definition of
// coverage.
#include "cpu/rows/tile_spans.h"

#include <algorithm>
#include <random>

#include "cpu/rows/row_kernels.h"
#include "gtest/gtest.h"
#include "support/meshes/meshes.h"

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

// Vertices inside, around and far outside of the grid; counts that no vector divides.
TEST(TileBoxes, AreTheScalarOnesOnEveryInstructionSet) {
  std::mt19937 random(11);
  std::vector<VertexCode> codes(500);
  for (VertexCode& code : codes) {
    for (int a = 0; a < 3; ++a) {
      const uint32_t kind = random() % 8;
      code.axis[a] = kind == 0   ? int16_t(random())
                     : kind == 1 ? int16_t(random() % 2 != 0 ? 32767 : -32768)
                                 : int16_t(int(random() % 160) - 20);
    }
    code.axis[3] = 0;
  }
  std::vector<std::array<uint32_t, 3>> triangles(4003);
  for (auto& triangle : triangles) {
    for (uint32_t& v : triangle) v = random() % 500;
  }
  const auto* const ids = reinterpret_cast<const uint32_t(*)[3]>(triangles.data());
  const auto boxes_by = [&](const RowKernels& kernels, const int64_t(&dims)[3]) {
    std::vector<TileBox> boxes(triangles.size());
    kernels.tile_boxes(ids, codes.data(), 0, int64_t(boxes.size()), dims, boxes.data());
    std::vector<std::array<int, 7>> all;
    for (const TileBox& box : boxes) {
      all.push_back({box.kind});
      for (int a = 0; a < 3 && box.kind == TileBox::kBoxed; ++a) {
        all.back()[size_t(1 + a)] = box.first[a];
        all.back()[size_t(4 + a)] = box.last[a];
      }
    }
    return all;
  };
  for (const auto& dims : {std::array<int64_t, 3>{64, 50, 47}, {kMaxCodedDim, 1, 9}}) {
    const int64_t voxels[3] = {dims[0], dims[1], dims[2]};
    const auto expected = boxes_by(**SelectRowKernels(SimdChoice::kScalar), voxels);
    for (const TileBox::Kind kind : {TileBox::kOutside, TileBox::kBoxed, TileBox::kLarge}) {
      EXPECT_TRUE(std::any_of(expected.begin(), expected.end(), [&](const auto& box) { return box[0] == kind; }));
    }
    for (const RowKernels* kernels : VectorKernels()) EXPECT_EQ(boxes_by(*kernels, voxels), expected) << kernels->name;
  }
}

}  // namespace
}  // namespace voxelpipe::cpu
