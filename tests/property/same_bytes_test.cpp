// The same request gives the same bytes: whatever the instruction set, the number of threads, the slabs, the way of
// delivery and, where the definition allows, the order of the triangles. Over all shaders, formats, blends and kinds of
// result.
#include <algorithm>
#include <array>
#include <random>

#include "cpu/rows/row_kernels.h"
#include "gtest/gtest.h"
#include "shaders/catalog.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

// One way of running a request.
struct Way {
  SimdChoice simd;
  int threads;
  int64_t slab_depth;
  bool streamed;
};

Arrays BytesOf(const TriangleMesh& mesh, VoxelizeRequest request, const Way& way) {
  request.simd = way.simd;
  request.threads = way.threads;
  PlanLimits limits;
  limits.slab_depth = way.slab_depth;
  const JobContext job;
  if (way.streamed) {
    KeepArrays sink;
    const auto stats = VoxelizeTo(mesh, request, {job, limits}, sink);
    EXPECT_TRUE(stats.ok()) << stats.status();
    return sink.arrays;
  }
  const auto result = Voxelize(mesh, request, {job, limits});
  EXPECT_TRUE(result.ok()) << result.status();
  return result.ok() ? CopyArrays(*result) : Arrays();
}

constexpr Way kPlain = {SimdChoice::kScalar, 1, 0, false};

// Every instruction set that this machine has, slabs and ways of delivery taking turns.
std::vector<Way> OtherWays() {
  std::vector<Way> ways = {{SimdChoice::kScalar, 2, 8, true}};
  if (cpu::SelectRowKernels(SimdChoice::kAvx2).ok()) ways.push_back({SimdChoice::kAvx2, 2, 8, false});
  if (cpu::SelectRowKernels(SimdChoice::kAvx512).ok()) ways.push_back({SimdChoice::kAvx512, 1, 16, false});
  return ways;
}

// All formats and blends for each shader, in requests of eight targets.
std::vector<VoxelizeRequest> AllRequests(const std::vector<ShaderCall>& shaders) {
  std::vector<TargetSpec> targets;
  for (const ShaderCall& shader : shaders) {
    for (int format = 0; format <= int(VoxelFormat::kF32); ++format) {
      for (int blend = 0; blend <= int(Blend::kAnd); ++blend) {
        if (!CheckBlend(VoxelFormat(format), Blend(blend)).ok()) continue;
        const int components = format == int(VoxelFormat::kBit) ? 1 : 1 + int(targets.size() % 4);
        targets.push_back(FloatTarget(components, Blend(blend), shader));
        targets.back().format = VoxelFormat(format);
        targets.back().clear = double(targets.size() % 3);
      }
    }
  }
  std::vector<VoxelizeRequest> requests;
  for (size_t i = 0; i < targets.size(); i += kMaxTargets) {
    VoxelizeRequest request;
    request.grid = UnitGrid(35, 12, 19);
    request.coverage = Coverage(requests.size() % 3);
    request.layout = Layout(requests.size() % 2);
    request.fill = std::array{Fill::kNone, Fill::kParity, Fill::kNonzero}[requests.size() / 2 % 3];
    request.targets.assign(targets.begin() + ptrdiff_t(i),
                           targets.begin() + ptrdiff_t(std::min(i + kMaxTargets, targets.size())));
    requests.push_back(request);
  }
  return requests;
}

std::vector<ShaderCall> AllShaders() {
  std::vector<ShaderCall> shaders;
  for (const ShaderInfo& info : ListShaders()) {
    if (info.stage != ShaderStage::kFragment) continue;
    ShaderCall call{info.name, {}};
    for (const ShaderParameterInfo& parameter : info.parameters) {
      if (parameter.type == "string") call.text[parameter.name] = "_HEAT";
    }
    shaders.push_back(call);
  }
  return shaders;
}

class SameBytes : public ::testing::TestWithParam<ResultKind> {};

TEST_P(SameBytes, OfEveryShaderFormatAndBlendInEveryWayOfRunning) {
  const TriangleMesh soup = AttributedSoup(96, 20, 21);
  const std::vector<ShaderCall> shaders = AllShaders();
  ASSERT_GE(shaders.size(), 19u);
  for (VoxelizeRequest& request : AllRequests(shaders)) {
    request.result = GetParam();
    if (GetParam() == ResultKind::kBuckets) request.fill = Fill::kNone;
    if (GetParam() == ResultKind::kBuckets && request.coverage == Coverage::kCenter) request.coverage = Coverage::kThin;
    const Arrays plain = BytesOf(soup, request, kPlain);
    ASSERT_FALSE(plain.empty());
    for (const Way& way : OtherWays()) {
      ASSERT_EQ(BytesOf(soup, request, way), plain)
          << Name(way.simd) << ", " << way.threads << " threads, slabs of " << way.slab_depth << ", first target "
          << request.targets[0].shader.name << " " << Name(request.targets[0].format);
    }
  }
}

TEST_P(SameBytes, OfPlainBitsWithEveryFill) {
  TriangleMesh mesh = BumpySphere(24, 9);
  for (Vec3d& p : mesh.positions) p = p * 17.0 + Vec3d{20, 20, 20};
  for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood, Fill::kNonzero}) {
    if (GetParam() == ResultKind::kBuckets && fill != Fill::kNone) continue;
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
      VoxelizeRequest request;
      request.grid = UnitGrid(41, 40, 39);
      request.fill = fill;
      request.coverage = coverage;
      request.result = GetParam();
      const Arrays plain = BytesOf(mesh, request, kPlain);
      for (const Way& way : OtherWays()) ASSERT_EQ(BytesOf(mesh, request, way), plain) << Name(way.simd) << Name(fill);
      ASSERT_EQ(BytesOf(mesh, request, kPlain), plain) << "a second run";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, SameBytes,
                         ::testing::Values(ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets),
                         [](const auto& test) { return std::string(Name(test.param)); });

// replace and first depend on triangle ids, and so do triangle_id and the parts' ids; nothing else does.
TEST(SameBytesOfShuffledTriangles, WhereIdsDoNotDecide) {
  TriangleMesh soup = AttributedSoup(96, 20, 22);
  std::vector<ShaderCall> shaders = AllShaders();
  std::erase_if(shaders, [](const ShaderCall& call) { return call.name == "triangle_id"; });
  std::vector<VoxelizeRequest> requests = AllRequests(shaders);
  for (VoxelizeRequest& request : requests) {
    std::erase_if(request.targets,
                  [](const TargetSpec& t) { return t.blend == Blend::kReplace || t.blend == Blend::kFirst; });
  }
  std::erase_if(requests, [](const VoxelizeRequest& request) { return request.targets.empty(); });
  TriangleMesh shuffled = soup;
  for (const MeshPart& part : soup.parts) {
    const auto begin = shuffled.triangles.begin() + ptrdiff_t(part.first_triangle);
    std::shuffle(begin, begin + ptrdiff_t(part.triangle_count), std::mt19937(4));
  }
  ASSERT_NE(shuffled.triangles, soup.triangles);
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
    for (VoxelizeRequest request : requests) {
      request.result = kind;
      ASSERT_EQ(BytesOf(shuffled, request, kPlain), BytesOf(soup, request, kPlain))
          << "first target " << request.targets[0].shader.name << " " << Name(request.targets[0].format);
    }
  }
}

}  // namespace
}  // namespace voxelpipe
