// A mesh that is placed gives the bytes of the same mesh written out: M p for every position, corners swapped where M
// mirrors; and placed meshes those of one mesh of their triangles.
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "mesh/placed_mesh.h"
#include "shaders/catalog.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

Arrays BytesOf(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  const VoxelizeResult result = RunPipeline(mesh, request);
  Arrays arrays = CopyArrays(result);
  const std::string counts = std::to_string(result.stats.occupied) + " " +
                             std::to_string(result.stats.odd_columns.value_or(0)) + " " +
                             std::to_string(result.stats.triangles_outside);
  arrays.emplace_back(counts.begin(), counts.end());
  return arrays;
}

struct Named {
  const char* name;
  Mat4d matrix;
};

std::vector<Named> Matrices() {
  Mat4d turn = Rotation({0.6, 0, 0.8}, 0.9), scale, mirror = Rotation({0, 0.6, 0.8}, 2.2), shear, tiny;
  turn.m[0][3] = 4.25;
  turn.m[1][3] = -1.125;
  scale.m[0][0] = 0.3;
  scale.m[1][1] = 1.7;
  scale.m[2][2] = 1.1;
  scale.m[2][3] = -2;
  for (auto& row : mirror.m) row[1] = -row[1];
  mirror.m[1][3] = 17;
  shear.m[0][1] = 0.4;
  shear.m[2][0] = -0.7;
  shear.m[2][3] = 6;
  for (int a = 0; a < 3; ++a) tiny.m[a][a] = -1e-3;  // inverts: three mirrors
  tiny.m[0][3] = 5;
  return {{"identity", {}}, {"turn", turn}, {"scale", scale}, {"mirror", mirror}, {"shear", shear}, {"tiny", tiny}};
}

double Determinant(const Mat4d& a) {
  const auto& m = a.m;
  return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

TriangleMesh WrittenOut(TriangleMesh mesh, const Mat4d& matrix) {
  const auto& m = matrix.m;
  for (Vec3d& p : mesh.positions) {
    const Vec3d q = p;
    for (int r = 0; r < 3; ++r) p[r] = ((m[r][0] * q.x + m[r][1] * q.y) + m[r][2] * q.z) + m[r][3];
  }
  if (Determinant(matrix) < 0) {
    for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  }
  return mesh;
}

// Every shader that a mesh without textures has, in requests of eight targets.
std::vector<VoxelizeRequest> AllShaders() {
  constexpr Blend kBlends[] = {Blend::kReplace, Blend::kFirst, Blend::kMax, Blend::kAdd, Blend::kAverage};
  std::vector<VoxelizeRequest> requests;
  for (const ShaderInfo& info : ListShaders()) {
    if (info.stage != ShaderStage::kFragment || info.name == "attribute") continue;
    for (const Blend blend : kBlends) {
      if (requests.empty() || requests.back().targets.size() == size_t(kMaxTargets)) {
        requests.emplace_back().targets.clear();
      }
      requests.back().targets.push_back(FloatTarget(3, blend, {info.name, {}}));
      if (info.name == "label") requests.back().targets.back().components = 1;
    }
  }
  return requests;
}

void ExpectSame(const TriangleMesh& a, const TriangleMesh& b, const char* what) {
  constexpr Fill kFills[] = {Fill::kNone, Fill::kParity, Fill::kNonzero};
  int turn = 0;
  for (VoxelizeRequest request : AllShaders()) {
    ++turn;
    request.grid = UnitGrid(18, 15, 17);
    if (turn % 3 == 0) {
      request.grid = {};
      request.grid.resolution = 19;
      request.grid.fit = turn % 2 == 0 ? GridFit::kCube : GridFit::kTight;
    }
    request.coverage = turn % 2 == 0 ? Coverage::kThin : Coverage::kConservative;
    request.result = std::array{ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}[size_t(turn) % 3];
    if (request.result != ResultKind::kBuckets) request.fill = kFills[turn % 3];
    request.parts.scope = turn % 4 == 0 ? PartScope::kFile : turn % 4 == 1 ? PartScope::kNode : PartScope::kWhole;
    ASSERT_EQ(BytesOf(a, request), BytesOf(b, request)) << what << ", request " << turn;
  }
}

TEST(PlacedBytes, OfAMeshWrittenOut) {
  for (const auto& [name, matrix] : Matrices()) {
    PlacedMesh placed;
    placed.mesh = std::make_shared<const TriangleMesh>(Soup(160, 16, 31));
    placed.matrix = matrix;
    const JobContext job;
    const auto joined = PlaceMeshes(job, {&placed, 1});
    ASSERT_TRUE(joined.ok()) << joined.status();
    ExpectSame(*joined, WrittenOut(*placed.mesh, matrix), name);
  }
}

// One run a mesh, its node and mesh numbers counted on.
TEST(PlacedBytes, OfAllMeshesInOne) {
  const auto soup = std::make_shared<const TriangleMesh>(Soup(40, 16, 5));
  std::vector<PlacedMesh> list;
  TriangleMesh all;
  for (const auto& [name, matrix] : Matrices()) {
    PlacedMesh& placed = list.emplace_back();
    placed.mesh = soup;
    placed.matrix = matrix;
    const TriangleMesh one = WrittenOut(*soup, matrix);
    MeshPart run = one.parts[0];
    run.first_triangle = all.triangles.size();
    run.first_vertex = all.positions.size();
    run.node = run.mesh = uint32_t(all.parts.size());
    const auto first = uint32_t(all.positions.size());
    for (const auto& t : one.triangles) all.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    all.positions.insert(all.positions.end(), one.positions.begin(), one.positions.end());
    all.parts.push_back(run);
  }
  const JobContext job;
  const auto joined = PlaceMeshes(job, list);
  ASSERT_TRUE(joined.ok()) << joined.status();
  for (VoxelizeRequest request : AllShaders()) {
    request.grid = UnitGrid(18, 15, 17);
    for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kNonzero}) {
      request.fill = fill;
      request.parts.scope = PartScope::kFile;
      const Arrays of_files = BytesOf(*joined, request);
      for (const PartScope scope : {PartScope::kNode, PartScope::kMesh}) {
        request.parts.scope = scope;
        ASSERT_EQ(BytesOf(all, request), of_files) << Name(scope) << " " << Name(fill);
      }
    }
  }
}

}  // namespace
}  // namespace voxelpipe
