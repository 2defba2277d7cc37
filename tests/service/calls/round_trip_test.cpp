// A served request gives the bytes of the same request in this process.
#include <algorithm>
#include <string>
#include <vector>

#include "cpu/rows/row_kernels.h"
#include "gtest/gtest.h"
#include "load/decode/image.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "pipeline/voxelize.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "shaders/catalog.h"

namespace voxelpipe::testing {
namespace {

class RoundTripTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = StartServer({"--log-level", "warn"});
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    const absl::StatusOr<Scene> scene = LoadScene(glb_);
    ASSERT_TRUE(scene.ok()) << scene.status();
    absl::StatusOr<TriangleMesh> mesh = Flatten(*scene);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    mesh_ = *std::move(mesh);
    ASSERT_TRUE(PrepareTextures(mesh_).ok());
  }

  // Runs `request` here and there.
  void ExpectSameBytes(const VoxelizeRequest& request) {
    const JobContext job;
    const absl::StatusOr<VoxelizeResult> here = Voxelize(mesh_, request, {job});
    ASSERT_TRUE(here.ok()) << here.status();
    Plan plan;
    const absl::StatusOr<RemoteResult> there =
        client_->Voxelize(glb_, MeshFormat::kGlb, request, job, [&](const Plan& p) { plan = p; });
    ASSERT_TRUE(there.ok()) << there.status();
    EXPECT_EQ(there->result.grid, here->grid);
    EXPECT_EQ(plan.grid, here->grid);
    EXPECT_EQ(there->result.layout, here->layout);
    EXPECT_EQ(there->result.kind, here->kind);
    const auto a = ArraysOf(there->result), b = ArraysOf(*here);
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 0; i < b.size(); ++i) {
      EXPECT_TRUE(std::equal(a[i].begin(), a[i].end(), b[i].begin(), b[i].end())) << "array " << i;
    }
    EXPECT_EQ(there->result.stats.triangles, here->stats.triangles);
    EXPECT_EQ(there->result.stats.fragments, here->stats.fragments);
    EXPECT_EQ(there->result.stats.occupied, here->stats.occupied);
    EXPECT_EQ(there->result.stats.odd_columns, here->stats.odd_columns);
    EXPECT_EQ(there->report.triangles, mesh_.triangles.size());
    EXPECT_GT(here->stats.occupied, 0u);
    last_ = there->content_sha256;
    last_simd_ = there->result.stats.simd;
  }

  const std::vector<uint8_t> glb_ = TorusGlb(12);
  TriangleMesh mesh_;
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::string last_;  // content hash of the last answer
  std::string last_simd_;
};

VoxelizeRequest Request(int64_t resolution) {
  VoxelizeRequest request;
  request.grid.resolution = resolution;
  return request;
}

TargetSpec Target(VoxelFormat format, int components, Blend blend, const ShaderCall& shader) {
  TargetSpec target;
  target.format = format;
  target.components = components;
  target.blend = blend;
  target.shader = shader;
  return target;
}

ShaderCall CallOf(const std::string& name) {
  ShaderCall call{name, {}};
  if (name == "constant") call.parameters["value"] = {0.5, -3, 0, 1e-3};
  return call;
}

// One test a shader, so that a failure names it.
class EveryShaderTest : public RoundTripTest, public ::testing::WithParamInterface<std::string> {};

TEST_P(EveryShaderTest, EveryTarget) {
  const ShaderCall shader = CallOf(GetParam());
  for (Blend blend : {Blend::kOr, Blend::kReplace}) {
    SCOPED_TRACE(std::string(Name(blend)) + " of bits");
    VoxelizeRequest request = Request(20);
    request.targets = {Target(VoxelFormat::kBit, 1, blend, shader)};
    ExpectSameBytes(request);
  }
  for (int components = 1; components <= 4; ++components) {
    for (Blend blend : {Blend::kReplace, Blend::kMin, Blend::kMax, Blend::kAdd}) {
      SCOPED_TRACE(std::string(Name(blend)) + " of " + std::to_string(components) + " floats");
      VoxelizeRequest request = Request(20);
      request.targets = {Target(VoxelFormat::kF32, components, blend, shader)};
      request.targets[0].clear = -0.25;
      request.layout = components % 2 == 0 ? Layout::kPlanar : Layout::kInterleaved;
      ExpectSameBytes(request);
    }
  }
}

std::vector<std::string> FragmentShaders() {
  std::vector<std::string> names;
  for (const ShaderInfo& info : ListShaders()) {
    // `attribute` needs the name of one that the mesh has.
    if (info.stage == ShaderStage::kFragment && info.name != "attribute") names.push_back(info.name);
  }
  return names;
}

INSTANTIATE_TEST_SUITE_P(Shaders, EveryShaderTest, ::testing::ValuesIn(FragmentShaders()),
                         [](const auto& test) { return test.param; });

TEST_F(RoundTripTest, EveryCoverageFillAndLayout) {
  std::vector<std::string> hashes;
  for (Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
    for (Fill fill : {Fill::kNone, Fill::kParity}) {
      for (Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
        SCOPED_TRACE(std::string(Name(coverage)) + " " + std::string(Name(fill)));
        VoxelizeRequest request = Request(33);
        request.coverage = coverage;
        request.fill = fill;
        request.layout = layout;
        request.targets = {Target(VoxelFormat::kF32, 3, Blend::kReplace, CallOf("normal"))};
        request.targets[0].fill_values = {7};
        ExpectSameBytes(request);
        EXPECT_EQ(std::count(hashes.begin(), hashes.end(), last_), 0) << "the choice made no difference";
        hashes.push_back(last_);
      }
    }
  }
}

TEST_F(RoundTripTest, EveryFormatBlendAndKindOfResult) {
  const std::vector<Blend> blends = {Blend::kOr,    Blend::kReplace, Blend::kMin,   Blend::kMax, Blend::kAdd,
                                     Blend::kFirst, Blend::kAverage, Blend::kCount, Blend::kAnd};
  for (const VoxelFormat format : {VoxelFormat::kBit, VoxelFormat::kU8, VoxelFormat::kU16, VoxelFormat::kU32,
                                   VoxelFormat::kF16, VoxelFormat::kF32}) {
    for (const Blend blend : blends) {
      if (!CheckBlend(format, blend).ok()) continue;
      for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
        SCOPED_TRACE(std::string(Name(format)) + " " + std::string(Name(blend)) + " " + std::string(Name(kind)));
        VoxelizeRequest request = Request(19);
        request.result = kind;
        request.layout = blend == Blend::kMax ? Layout::kPlanar : Layout::kInterleaved;
        request.targets = {Target(format, format == VoxelFormat::kBit ? 1 : 3, blend, CallOf("barycentric")),
                           Target(VoxelFormat::kBit, 1, Blend::kOr, CallOf("occupancy"))};
        if (format == VoxelFormat::kU16) request.targets[0].scale = 1000;
        ExpectSameBytes(request);
      }
    }
  }
}

TEST_F(RoundTripTest, FloodOnEveryInstructionSetOfThisMachine) {
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
      VoxelizeRequest request = Request(40);
      request.fill = Fill::kFlood;
      request.coverage = coverage;
      request.result = kind;
      ExpectSameBytes(request);
      const std::string flooded = last_;
      std::vector<std::string> ran;
      for (const SimdChoice simd : {SimdChoice::kScalar, SimdChoice::kAvx2, SimdChoice::kAvx512}) {
        const absl::StatusOr<const cpu::RowKernels*> kernels = cpu::SelectRowKernels(simd);
        if (!kernels.ok()) continue;  // this machine does not have it
        SCOPED_TRACE(std::string(Name(coverage)) + " " + std::string(Name(simd)));
        request.simd = simd;
        ExpectSameBytes(request);
        EXPECT_EQ(last_, flooded);
        EXPECT_EQ(last_simd_, (*kernels)->name) << "the server took another instruction set";
        ran.push_back(last_simd_);
      }
      ASSERT_FALSE(ran.empty());
      EXPECT_EQ(ran.front(), "scalar");
      EXPECT_EQ(ran.back(), (*cpu::SelectRowKernels(SimdChoice::kAuto))->name) << "the best one of this machine";
    }
  }
}

TEST_F(RoundTripTest, SeveralTargetsAtOnce) {
  VoxelizeRequest request = Request(37);
  request.fill = Fill::kParity;
  request.targets = {Target(VoxelFormat::kBit, 1, Blend::kOr, CallOf("occupancy")),
                     Target(VoxelFormat::kF32, 4, Blend::kReplace, CallOf("base_color")),
                     Target(VoxelFormat::kF32, 1, Blend::kAdd, CallOf("constant")),
                     Target(VoxelFormat::kBit, 1, Blend::kReplace, CallOf("triangle_id")),
                     Target(VoxelFormat::kF32, 2, Blend::kMin, CallOf("barycentric"))};
  request.targets[2].quantum = 0.25;
  ExpectSameBytes(request);
}

TEST_F(RoundTripTest, EveryWayToAskForAGrid) {
  VoxelizeRequest cube = Request(24);
  cube.grid.fit = GridFit::kCube;
  cube.grid.padding = 3;
  ExpectSameBytes(cube);

  VoxelizeRequest voxel_size;
  voxel_size.grid.voxel_size = Vec3d{0.1, 0.125, 0.3};
  voxel_size.grid.padding = 1;
  ExpectSameBytes(voxel_size);

  VoxelizeRequest given;
  given.grid.voxel_size = Vec3d{0.1, 0.1, 0.1};
  given.grid.dims = {17, 30, 9};
  given.grid.origin = Vec3d{2.5, -3.0, 0.1};
  ExpectSameBytes(given);
}

TEST_F(RoundTripTest, VertexShaderWithParameters) {
  VoxelizeRequest request = Request(20);
  request.vertex_shader = {"transform", {{"matrix", {0.8, -0.6, 0, 1, 0.6, 0.8, 0, 2, 0, 0, 1.1, 3, 0, 0, 0, 1}}}};
  request.targets = {Target(VoxelFormat::kF32, 3, Blend::kMax, CallOf("geometric_normal"))};
  ExpectSameBytes(request);
}

// More than one piece a target, and pieces that end at the target's end.
TEST_F(RoundTripTest, AResultOfManyPieces) {
  VoxelizeRequest request = Request(150);
  request.targets = {Target(VoxelFormat::kF32, 3, Blend::kReplace, CallOf("normal")),
                     Target(VoxelFormat::kBit, 1, Blend::kOr, CallOf("occupancy"))};
  ExpectSameBytes(request);
}

TEST_F(RoundTripTest, ShaderListsAgree) {
  const absl::StatusOr<std::vector<ShaderInfo>> there = client_->ListShaders();
  ASSERT_TRUE(there.ok()) << there.status();
  const std::span<const ShaderInfo> here = ListShaders();
  ASSERT_EQ(there->size(), here.size());
  for (size_t i = 0; i < here.size(); ++i) {
    EXPECT_EQ((*there)[i].name, here[i].name);
    EXPECT_EQ((*there)[i].stage, here[i].stage);
    EXPECT_EQ((*there)[i].description, here[i].description);
    EXPECT_EQ((*there)[i].output_type, here[i].output_type);
    EXPECT_EQ((*there)[i].output_components, here[i].output_components);
    EXPECT_EQ((*there)[i].reads_textures, here[i].reads_textures);
    ASSERT_EQ((*there)[i].parameters.size(), here[i].parameters.size());
    for (size_t p = 0; p < here[i].parameters.size(); ++p) {
      EXPECT_EQ((*there)[i].parameters[p].name, here[i].parameters[p].name);
      EXPECT_EQ((*there)[i].parameters[p].type, here[i].parameters[p].type);
      EXPECT_EQ((*there)[i].parameters[p].default_value, here[i].parameters[p].default_value);
    }
  }
}

}  // namespace
}  // namespace voxelpipe::testing
