// What benchmarks compare must be comparable: closed meshes of the size they say, files that hold them, and a yardstick
// that marks the same voxels.
#include <bit>

#include "bench/inputs/attributes.h"
#include "bench/inputs/mesh_files.h"
#include "bench/meshes.h"
#include "bench/peers/yardstick.h"
#include "gtest/gtest.h"
#include "load/load_mesh.h"
#include "mesh/report.h"
#include "pipeline/voxelize.h"

namespace voxelpipe::bench {
namespace {

TEST(BenchMeshes, AreClosedAndOfTheSizeTheySay) {
  EXPECT_NEAR(double(BumpySphere(70'000).triangles.size()), 70'000, 1'000);
  EXPECT_NEAR(double(BumpyTorus(60'000).triangles.size()), 60'000, 1'000);
  EXPECT_EQ(*CountOpenEdges({}, BumpyTorus(6'000)), 0u);
  const TriangleMesh coarse = BumpyTorus(600);
  const TriangleMesh fine = Subdivided(coarse, 2);
  EXPECT_EQ(fine.triangles.size(), coarse.triangles.size() * 16);
  EXPECT_EQ(*CountOpenEdges({}, fine), 0u);
  EXPECT_EQ(Mixed().triangles.size(), 120'092u);
  const TriangleMesh coarser = Decimated(BumpySphere(70'000), 5'800);
  EXPECT_LE(coarser.triangles.size(), 5'800u);
  EXPECT_GE(coarser.triangles.size(), 5'500u);
  const TriangleMesh nasty = Nasty();
  EXPECT_EQ(nasty.triangles.size(), 2'000'024u);
  EXPECT_EQ(nasty.positions.size(), 3 * nasty.triangles.size());
}

// Every room of the maze is open: a flood leaves nothing but the walls.
TEST(BenchMeshes, MazeIsOneWayThroughAllItsRooms) {
  EXPECT_NEAR(double(Maze(27).triangles.size()), 80'000, 4'000);
  const TriangleMesh maze = Maze(8);
  // A tree has one door less than rooms.
  EXPECT_EQ(maze.triangles.size() / 2, 3u * 9 * 8 * 8 - (8 * 8 * 8 - 1) - 1);
  VoxelizeRequest request;
  request.grid.resolution = 65;
  const auto walls = Voxelize(maze, request, {JobContext()});
  request.fill = Fill::kFlood;
  const auto flooded = Voxelize(maze, request, {JobContext()});
  ASSERT_TRUE(walls.ok() && flooded.ok());
  EXPECT_EQ(flooded->stats.occupied, walls->stats.occupied);
}

TEST(BenchFiles, HoldTheMeshTheyWereMadeOf) {
  TriangleMesh mesh = BumpySphere(500);
  AddAttributes(mesh, {32, true});
  LoadRequest load;
  load.textures.base_color = true;
  const auto glb = LoadMeshFor(JobContext(), GlbBytes(mesh), load);
  ASSERT_TRUE(glb.ok()) << glb.status();
  EXPECT_EQ(glb->mesh.triangles, mesh.triangles);
  EXPECT_EQ(glb->mesh.normals.size(), mesh.positions.size());
  EXPECT_EQ(glb->mesh.uv[0].size(), mesh.positions.size());
  ASSERT_EQ(glb->mesh.images.size(), 1u);
  EXPECT_EQ(glb->mesh.images[0]->rgba, mesh.images[0]->rgba);
  EXPECT_EQ(glb->mesh.materials[0].alpha_mode, AlphaMode::kMask);
  const auto stl = LoadMeshFor(JobContext(), StlBytes(mesh), {.type = MeshFormat::kStl});
  ASSERT_TRUE(stl.ok()) << stl.status();
  EXPECT_EQ(stl->mesh.triangles.size(), mesh.triangles.size());
}

TEST(Yardstick, MarksTheVoxelsOfTheConservativeCoverage) {
  for (const TriangleMesh& mesh : {BumpySphere(2'000), BumpyTorus(3'000)}) {
    VoxelizeRequest request;
    request.grid.resolution = 60;
    const auto ours = Voxelize(mesh, request, {JobContext()});
    ASSERT_TRUE(ours.ok());
    const std::vector<uint8_t> plain = PlainLoop(mesh, ours->grid);
    uint64_t missed = 0, extra = 0, marked = 0;
    for (size_t i = 0; i < plain.size(); ++i) {
      const uint8_t other = ours->targets[0].data()[i];
      missed += uint64_t(std::popcount(uint8_t(plain[i] & ~other)));
      extra += uint64_t(std::popcount(uint8_t(other & ~plain[i])));
      marked += uint64_t(std::popcount(plain[i]));
    }
    EXPECT_EQ(missed, 0u);
    EXPECT_LT(extra, marked / 500) << "only what lies within the widening";
    EXPECT_GT(marked, 5'000u);
  }
}

}  // namespace
}  // namespace voxelpipe::bench
