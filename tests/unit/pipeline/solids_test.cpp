// Solids as simulation and printing use them: exact counts of voxels whose centres are inside, parts that overlap, and
// what filled voxels hold.
#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/reference/fill_reference.h"
#include "support/reference/value_reference.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;
using ::testing::HasSubstr;

constexpr Fill kCastFills[] = {Fill::kParity, Fill::kNonzero};

// Parts of a mesh, one behind the other.
TriangleMesh Together(std::initializer_list<TriangleMesh> parts) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (const TriangleMesh& part : parts) {
    const auto first = uint32_t(positions.size());
    positions.insert(positions.end(), part.positions.begin(), part.positions.end());
    for (const auto& t : part.triangles) triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
  return MakeMesh(std::move(positions), std::move(triangles));
}

// A box with its corners at `from` and `upto`, outward winding.
TriangleMesh Box(const Vec3d& from, const Vec3d& upto) {
  TriangleMesh box = Cube(1);
  for (Vec3d& p : box.positions) {
    for (int a = 0; a < 3; ++a) p[a] = from[a] + p[a] * (upto[a] - from[a]);
  }
  return box;
}

VoxelizeRequest Solid(Coverage coverage, Fill fill) {
  VoxelizeRequest request;
  request.coverage = coverage;
  request.fill = fill;
  return request;
}

// float32 corners, as files have them.
TriangleMesh Float32(TriangleMesh mesh) {
  for (Vec3d& p : mesh.positions) {
    for (int a = 0; a < 3; ++a) p[a] = double(float(p[a]));
  }
  return mesh;
}

TEST(Solids, ACubeOfEightVoxelsHas512AndNoMore) {
  for (const Fill fill : kCastFills) {
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
      VoxelizeRequest request = Solid(Coverage::kNone, fill);
      request.result = kind;
      request.grid.voxel_size = Vec3d{1, 1, 1};
      request.grid.padding = 1;
      const VoxelizeResult result = RunPipeline(Cube(8), request);
      EXPECT_EQ(result.grid.dims, (std::array<int64_t, 3>{10, 10, 10}));
      EXPECT_EQ(result.stats.occupied, 512u);
      EXPECT_EQ(result.stats.fragments, 0u);
      EXPECT_EQ(result.stats.odd_columns, 0u);
    }
  }
}

TEST(Solids, ACubeOf20CentimetresHasTwoVoxelsOf10AnAxisWhereverItLies) {
  for (const double at : {-1.3, -0.1, 0.0, 0.7, 12.9, 100.3}) {
    VoxelizeRequest request = Solid(Coverage::kConservative, Fill::kParity);
    request.grid.voxel_size = Vec3d{0.1, 0.1, 0.1};
    const TriangleMesh cube = Float32(Box({at, at, at}, {at + 0.2, at + 0.2, at + 0.2}));
    const VoxelizeResult result = RunPipeline(cube, request);
    EXPECT_EQ(result.grid.dims, (std::array<int64_t, 3>{2, 2, 2})) << at;
    EXPECT_EQ(result.stats.occupied, 8u) << at;
    for (const Fill fill : kCastFills) {
      request.coverage = Coverage::kNone;
      request.fill = fill;
      EXPECT_EQ(RunPipeline(cube, request).stats.occupied, 8u) << at;
    }
  }
}

// The far wall lies a rounding of float32 beyond the last voxel: that it is not lost shows in the last layer of each
// axis.
TEST(Solids, TheFarWallOfAFloat32MeshIsKept) {
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
    for (const bool shaded : {false, true}) {
      VoxelizeRequest request = Solid(coverage, Fill::kNone);
      request.grid.voxel_size = Vec3d{0.1, 0.1, 0.1};
      if (shaded) request.targets = {FloatTarget(1, Blend::kCount, {"occupancy", {}})};
      // The float32 after 1: a millionth of a voxel more than ten.
      const TriangleMesh cube =
          Box({0, 0, 0}, {double(1.0f) + 0x1p-23, double(1.0f) + 0x1p-23, double(1.0f) + 0x1p-23});
      for (const SimdChoice simd : {SimdChoice::kScalar, SimdChoice::kAuto}) {
        request.simd = simd;
        const VoxelizeResult result = RunPipeline(cube, request);
        ASSERT_EQ(result.grid.dims, (std::array<int64_t, 3>{10, 10, 10}));
        EXPECT_EQ(result.stats.occupied, 1000u - 512u) << Name(coverage) << shaded << Name(simd);
      }
    }
  }
}

TEST(Solids, BoxesThatOverlapAreHollowByParityAndFullByNonzero) {
  // 8^3 each, 4^3 of which they share.
  const TriangleMesh boxes = Together({Box({2, 2, 2}, {10, 10, 10}), Box({6, 6, 6}, {14, 14, 14})});
  VoxelizeRequest request = Solid(Coverage::kNone, Fill::kParity);
  request.grid = UnitGrid(16, 16, 16);
  EXPECT_EQ(RunPipeline(boxes, request).stats.occupied, 512u + 512u - 2 * 64u);
  request.fill = Fill::kNonzero;
  const VoxelizeResult full = RunPipeline(boxes, request);
  EXPECT_EQ(full.stats.occupied, 512u + 512u - 64u);
  EXPECT_EQ(full.stats.odd_columns, 0u);
  // The same shell twice.
  const TriangleMesh twice = Together({Box({2, 2, 2}, {10, 10, 10}), Box({2, 2, 2}, {10, 10, 10})});
  EXPECT_EQ(RunPipeline(twice, request).stats.occupied, 512u);
  request.fill = Fill::kParity;
  EXPECT_EQ(RunPipeline(twice, request).stats.occupied, 0u);
}

TEST(Solids, NonzeroCountsColumnsWhoseSignsDoNotSumTo0) {
  TriangleMesh open = Box({2, 2, 2}, {10, 10, 10});
  VoxelizeRequest request = Solid(Coverage::kNone, Fill::kNonzero);
  request.grid = UnitGrid(12, 12, 12);
  ASSERT_EQ(RunPipeline(open, request).stats.odd_columns, 0u);
  // Without one triangle of the sides that lines along x cross: half of the 64 columns, more or less its diagonal.
  for (size_t t = 0; t < open.triangles.size(); ++t) {
    const auto& v = open.triangles[t];
    const double x = open.positions[v[0]].x;
    if (open.positions[v[1]].x != x || open.positions[v[2]].x != x) continue;
    open.triangles.erase(open.triangles.begin() + int64_t(t));
    break;
  }
  const VoxelizeResult result = RunPipeline(open, request);
  EXPECT_GE(result.stats.odd_columns.value_or(0), 28u);
  EXPECT_LE(result.stats.odd_columns.value_or(0), 36u);
  // Two walls that face the same way have an even number of crossings, and are odd all the same.
  const TriangleMesh walls =
      MakeMesh({{3, 0, 0}, {3, 40, 0}, {3, 0, 40}, {7, 0, 0}, {7, 40, 0}, {7, 0, 40}}, {{0, 1, 2}, {3, 4, 5}});
  EXPECT_EQ(RunPipeline(walls, request).stats.odd_columns, 144u);
  request.fill = Fill::kParity;
  EXPECT_EQ(RunPipeline(walls, request).stats.odd_columns, 0u);
}

// A box that turns about an axis through its middle: inside the velocity is that of the voxel's centre, on the surface
// that of the triangle's point.
TEST(Solids, InsideATurningBodyTheVelocityIsOmegaCrossR) {
  const Vec3d omega{0.25, 3, -0.5}, linear{1.5, -0.25, 0.5}, center{8, 7, 6};
  VoxelizeRequest request = Solid(Coverage::kConservative, Fill::kParity);
  request.grid = UnitGrid(16, 14, 12);
  request.vertex_shader = {"identity",
                           {{"linear_velocity", {linear.x, linear.y, linear.z}},
                            {"angular_velocity", {omega.x, omega.y, omega.z}},
                            {"center", {center.x, center.y, center.z}}}};
  request.targets = {FloatTarget(3, Blend::kAverage, {"velocity", {}}),
                     FloatTarget(3, Blend::kAverage, {"position", {}}),
                     FloatTarget(1, Blend::kCount, {"occupancy", {}}), TargetSpec{}};
  const TriangleMesh body = Box({3, 3, 3}, {13, 11, 9});
  const VoxelizeResult result = RunPipeline(body, request);
  uint64_t inside = 0, surface = 0;
  const auto at = [&](size_t target, uint64_t n, int a) {
    return double(FloatAt(result.targets[target], n * 3 + uint64_t(a)));
  };
  for (uint64_t n = 0; n < result.grid.voxels(); ++n) {
    if (!BitAt(result.targets[3], n)) continue;
    const bool covered = FloatAt(result.targets[2], n) > 0;
    const Vec3d centre{double(n % 16) + 0.5, double(n / 16 % 14) + 0.5, double(n / 224) + 0.5};
    const Vec3d p = covered ? Vec3d{at(1, n, 0), at(1, n, 1), at(1, n, 2)} : centre;
    const Vec3d expected = linear + Cross(omega, p - center);
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(at(0, n, a), expected[a], covered ? 1e-4 : 1e-6) << n;
    for (int a = 0; a < 3 && !covered; ++a) EXPECT_EQ(at(0, n, a), double(float(expected[a]))) << n;
    ++(covered ? surface : inside);
  }
  EXPECT_EQ(inside, 8u * 6u * 4u) << "the shell takes the outermost layer";
  EXPECT_GT(surface, 0u);
}

// Every shader, blend, encoding and kind of fill number, against a reference; under no coverage all that a result holds
// is fill.
TEST(Solids, FilledVoxelsHoldWhatTheShaderGivesWithoutATriangle) {
  const TriangleMesh body = Box({1, 1, 1}, {35, 7, 6});
  for (const std::string shader :
       {"occupancy", "constant", "checker", "position", "velocity", "normal", "triangle_id", "base_color"}) {
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
      VoxelizeRequest request = Solid(Coverage::kNone, Fill::kNonzero);
      request.result = kind;
      request.grid = UnitGrid(37, 9, 8);
      request.layout = kind == ResultKind::kDense ? Layout::kPlanar : Layout::kInterleaved;
      request.vertex_shader = {"displace_along_normal", {{"angular_velocity", {0, 0, 40.125}}, {"center", {3, -2, 1}}}};
      request.targets.clear();
      for (const auto& [format, blend, components] : {std::tuple{VoxelFormat::kF32, Blend::kReplace, 4},
                                                      {VoxelFormat::kF16, Blend::kAverage, 3},
                                                      {VoxelFormat::kU8, Blend::kAdd, 2},
                                                      {VoxelFormat::kU16, Blend::kCount, 1},
                                                      {VoxelFormat::kU32, Blend::kMin, 3},
                                                      {VoxelFormat::kBit, Blend::kOr, 1}}) {
        TargetSpec target;
        target.format = format;
        target.blend = blend;
        target.components = components;
        target.shader.name = shader;
        target.clear = 9;
        if (shader == "constant") target.shader.parameters["value"] = {0.75, 300, -2};
        request.targets.push_back(target);
      }
      request.targets[3].fill_values = {4};
      request.targets.push_back(request.targets[0]);
      request.targets.back().fill_values = {1, 2.5, -3, 1e9};
      request.targets.push_back(request.targets[1]);
      request.targets.back().fill_values = {0.1};
      std::vector<bool> inside(37 * 9 * 8);
      for (int64_t n = 0; n < int64_t(inside.size()); ++n) {
        const int64_t x = n % 37, y = n / 37 % 9, z = n / 37 / 9;
        inside[size_t(n)] = x >= 1 && x < 35 && y >= 1 && y < 7 && z >= 1 && z < 6;
      }
      const VoxelizeResult result = RunPipeline(body, request);
      std::vector<std::vector<uint8_t>> got;
      for (const auto bytes : ArraysOf(result)) got.emplace_back(bytes.begin(), bytes.end());
      TriangleMesh nothing = body;  // no voxel is covered
      nothing.triangles.clear();
      EXPECT_EQ(got, ReferenceArrays(nothing, request, inside)) << shader << " " << Name(kind);
    }
  }
}

TEST(Solids, AVertexShadersOwnVelocityIsNotThatOfTheInside) {
  VoxelizeRequest request = Solid(Coverage::kNone, Fill::kParity);
  request.grid = UnitGrid(6, 6, 6);
  request.vertex_shader = {"transform", {{"dt", {0.5}}, {"linear_velocity", {1, 2, 3}}}};
  request.targets = {FloatTarget(3, Blend::kAverage, {"velocity", {}})};
  request.targets[0].clear = -7;
  const VoxelizeResult moved = RunPipeline(Cube(6), request);
  EXPECT_EQ(FloatAt(moved.targets[0], 0), -7);
  request.vertex_shader.parameters["dt"] = {0};
  const VoxelizeResult still = RunPipeline(Cube(6), request);
  EXPECT_EQ(FloatAt(still.targets[0], 1), 2);
}

TEST(Solids, RefuseWhatHasNoMeaningByTheNameOfTheField) {
  const auto error = [](auto change) {
    VoxelizeRequest request = Solid(Coverage::kNone, Fill::kParity);
    change(request);
    const absl::Status s = RunError(Cube(4), request);
    EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument) << s;
    return std::string(s.message());
  };
  EXPECT_THAT(error([](auto& r) { r.fill = Fill::kNone; }), HasSubstr("coverage: none takes fill parity or nonzero"));
  EXPECT_THAT(error([](auto& r) { r.fill = Fill::kFlood; }), HasSubstr("coverage: none takes fill parity or nonzero"));
  EXPECT_THAT(error([](auto& r) {
                r.fill = Fill::kNone;
                r.result = ResultKind::kBuckets;
              }),
              HasSubstr("coverage: none"));
  EXPECT_THAT(error([](auto& r) {
                r.coverage = Coverage::kThin;
                r.fill = Fill::kNonzero;
                r.result = ResultKind::kBuckets;
              }),
              HasSubstr("fill: "));
  EXPECT_THAT(error([](auto& r) { r.targets[0].fill_values = {1, 2}; }), HasSubstr("targets[0].fill: "));
  EXPECT_THAT(error([](auto& r) { r.targets[0].encoding = Encoding::kSrgb; }), HasSubstr("targets[0].encoding"));
  const auto encoded = [&](Encoding encoding, VoxelFormat format, const char* shader) {
    return [=](auto change) {
      return error([&](auto& r) {
        r.targets[0] = FloatTarget(3, Blend::kReplace, {shader, {}});
        r.targets[0].format = format;
        r.targets[0].encoding = encoding;
        change(r.targets[0]);
      });
    };
  };
  const auto srgb = encoded(Encoding::kSrgb, VoxelFormat::kU8, "base_color");
  const auto snorm = encoded(Encoding::kSnorm, VoxelFormat::kU16, "normal");
  EXPECT_THAT(srgb([](auto& t) { t.format = VoxelFormat::kU16; }), HasSubstr("targets[0].encoding: srgb is for u8"));
  EXPECT_THAT(srgb([](auto& t) { t.scale = 2; }), HasSubstr("targets[0].encoding: srgb and scale"));
  EXPECT_THAT(srgb([](auto& t) { t.shader.name = "normal"; }),
              HasSubstr("targets[0].encoding: srgb is for the shaders"));
  for (const Blend blend : {Blend::kCount, Blend::kAnd, Blend::kOr}) {
    EXPECT_THAT(srgb([blend](auto& t) { t.blend = blend; }), HasSubstr("targets[0].encoding: srgb does not go"));
  }
  EXPECT_THAT(snorm([](auto& t) { t.format = VoxelFormat::kU32; }), HasSubstr("snorm is for u8 and u16"));
  EXPECT_THAT(snorm([](auto& t) { t.format = VoxelFormat::kU8Snorm; }), HasSubstr("targets[0].format"));
  EXPECT_THAT(snorm([](auto& t) { t.scale = 2; }), HasSubstr("targets[0].encoding: snorm and scale"));
  EXPECT_THAT(snorm([](auto& t) { t.shader.name = "base_color"; }), HasSubstr("snorm is for the shaders normal"));
  EXPECT_THAT(snorm([](auto& t) { t.blend = Blend::kOr; }), HasSubstr("snorm does not go with or"));
}

// Random meshes under every blend that sRGB takes, against the transfer function in long double; dense, sparse and
// buckets.
TEST(Solids, SrgbIsTheTransferFunctionUnderEveryBlend) {
  const TriangleMesh mesh = AttributedSoup(60, 20, 11);
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    VoxelizeRequest request;
    request.result = kind;
    request.grid = UnitGrid(20, 19, 18);
    request.targets.clear();
    for (const Blend blend : {Blend::kReplace, Blend::kFirst, Blend::kMin, Blend::kMax, Blend::kAdd, Blend::kAverage}) {
      for (const int components : {3, 4}) {
        if (request.targets.size() == size_t{kMaxTargets}) break;
        TargetSpec target = FloatTarget(components, blend, {components == 3 ? "color" : "base_color", {}});
        target.format = VoxelFormat::kU8;
        target.encoding = Encoding::kSrgb;
        target.clear = 17;
        request.targets.push_back(target);
      }
    }
    for (TargetSpec& target : request.targets) {
      const auto index = size_t(&target - request.targets.data());
      if (index >= 4) target.blend = std::array{Blend::kMax, Blend::kMin, Blend::kAdd, Blend::kAverage}[index - 4];
    }
    const VoxelizeResult result = RunPipeline(mesh, request);
    std::vector<std::vector<uint8_t>> got;
    for (const auto bytes : ArraysOf(result)) got.emplace_back(bytes.begin(), bytes.end());
    EXPECT_EQ(got, ReferenceArrays(mesh, request)) << Name(kind);
  }
}

TEST(Solids, SnormIsItsFormulaUnderEveryBlend) {
  const TriangleMesh mesh = AttributedSoup(60, 20, 12);
  const std::array<const char*, 3> shaders{"normal", "geometric_normal", "tangent"};
  for (const VoxelFormat format : {VoxelFormat::kU8, VoxelFormat::kU16}) {
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
      VoxelizeRequest request;
      request.result = kind;
      request.grid = UnitGrid(20, 19, 18);
      request.targets.clear();
      for (const Blend blend :
           {Blend::kReplace, Blend::kFirst, Blend::kMin, Blend::kMax, Blend::kAdd, Blend::kAverage}) {
        const char* const shader = shaders[request.targets.size() % 3];
        TargetSpec target = FloatTarget(request.targets.size() % 3 == 2 ? 4 : 3, blend, {shader, {}});
        target.format = format;
        target.encoding = Encoding::kSnorm;
        target.clear = 17;
        request.targets.push_back(target);
      }
      const VoxelizeResult result = RunPipeline(mesh, request);
      std::vector<std::vector<uint8_t>> got;
      for (const auto bytes : ArraysOf(result)) got.emplace_back(bytes.begin(), bytes.end());
      EXPECT_EQ(got, ReferenceArrays(mesh, request)) << Name(kind) << " " << Name(format);
    }
  }
}

}  // namespace
}  // namespace voxelpipe
