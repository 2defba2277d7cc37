// Every value of every result kind against the slow reference, byte for byte.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <limits>

#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/reference/value_reference.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

constexpr std::array<int64_t, 3> kDims = {37, 11, 18};  // more than a tile along x and z, none of them whole

const VoxelFormat kFormats[] = {VoxelFormat::kBit, VoxelFormat::kU8,  VoxelFormat::kU16,
                                VoxelFormat::kU32, VoxelFormat::kF16, VoxelFormat::kF32};
const Blend kBlends[] = {Blend::kOr,    Blend::kReplace, Blend::kMin,   Blend::kMax, Blend::kAdd,
                         Blend::kFirst, Blend::kAverage, Blend::kCount, Blend::kAnd};

// Every format with every blend it has and 1 to 4 components, the shaders taking turns.
std::vector<TargetSpec> EveryTarget(const std::vector<ShaderCall>& shaders) {
  std::vector<TargetSpec> targets;
  for (const VoxelFormat format : kFormats) {
    for (const Blend blend : kBlends) {
      if (!CheckBlend(format, blend).ok()) continue;
      for (int components = 1; components <= (format == VoxelFormat::kBit ? 1 : 4); ++components) {
        TargetSpec target = TargetOf(format, components, blend, shaders[targets.size() % shaders.size()]);
        target.clear = double(targets.size() % 5) * 77.5 - 60;
        if (targets.size() % 5 < 3) target.fill_values = {double(targets.size() % 7) * 40.5};
        if (targets.size() % 5 == 3) target.fill_values.assign(size_t(components), 2.5);
        targets.push_back(target);
      }
    }
  }
  return targets;
}

VoxelizeRequest Request(ResultKind kind, Coverage coverage, Layout layout) {
  VoxelizeRequest request;
  request.grid = UnitGrid(kDims[0], kDims[1], kDims[2]);
  request.result = kind;
  request.coverage = coverage;
  request.layout = layout;
  request.threads = 2;
  return request;
}

void ExpectReference(const TriangleMesh& mesh, const VoxelizeRequest& request, const std::vector<bool>& inside = {}) {
  const VoxelizeResult result = RunPipeline(mesh, request);
  const auto arrays = ArraysOf(result);
  const auto expected = ReferenceArrays(mesh, request, inside);
  const ResultHeader header = HeaderOf(result);
  ASSERT_EQ(arrays.size(), expected.size());
  for (size_t i = 0; i < arrays.size(); ++i) {
    ASSERT_EQ(arrays[i].size(), expected[i].size()) << header.arrays[i].name;
    for (size_t at = 0; at < expected[i].size(); ++at) {
      if (arrays[i][at] == expected[i][at]) continue;
      const size_t t = i - (arrays.size() - request.targets.size());
      std::string what = header.arrays[i].name;
      if (t < request.targets.size()) {
        const TargetSpec& spec = request.targets[t];
        what += " " + std::string(Name(spec.format)) + "x" + std::to_string(spec.components) + ":" +
                std::string(Name(spec.blend)) + ":" + spec.shader.name;
      }
      FAIL() << Name(request.result) << " " << Name(request.coverage)
             << (request.layout == Layout::kPlanar ? " planar, " : ", ") << what << ": byte " << at << " is "
             << int(arrays[i][at]) << ", not " << int(expected[i][at]);
    }
  }
}

// A request takes eight targets: goes through all of them, kinds, coverages and layouts taking turns by `turn`.
void ExpectReferenceOfAll(const TriangleMesh& mesh, const std::vector<TargetSpec>& targets, ResultKind kind,
                          uint32_t turn) {
  for (size_t first = 0; first < targets.size(); first += kMaxTargets, ++turn) {
    Coverage coverage = Coverage(turn % 3);
    if (kind == ResultKind::kBuckets && coverage == Coverage::kCenter) coverage = Coverage::kThin;
    VoxelizeRequest request = Request(kind, coverage, Layout(turn % 2));
    request.targets.assign(targets.begin() + ptrdiff_t(first),
                           targets.begin() + ptrdiff_t(std::min(first + kMaxTargets, targets.size())));
    ASSERT_NO_FATAL_FAILURE(ExpectReference(mesh, request));
  }
}

class ValuesTest : public ::testing::TestWithParam<ResultKind> {};

TEST_P(ValuesTest, OfEveryFormatBlendAndNumberOfComponents) {
  const TriangleMesh soup = AttributedSoup(160, 20, 7);
  const std::vector<TargetSpec> targets = EveryTarget(
      {{"color", {}}, {"triangle_id", {}}, {"geometric_normal", {}}, {"packed_normal", {}}, {"position", {}}});
  for (uint32_t turn = 0; turn < 2; ++turn) ExpectReferenceOfAll(soup, targets, GetParam(), turn);
}

TEST_P(ValuesTest, OfHostileNumbersInEveryBlend) {
  ExpectReferenceOfAll(AttributedSoup(160, 20, 8), EveryTarget({{"color", {}}}), GetParam(), 1);
}

TEST_P(ValuesTest, OfShadersThatDiscard) {
  const TriangleMesh soup = AttributedSoup(160, 20, 9);
  const std::vector<TargetSpec> all = EveryTarget({{"base_color", {}}, {"emissive", {}}, {"metallic_roughness", {}}});
  ExpectReferenceOfAll(soup, {all.begin(), all.begin() + 64}, GetParam(), 0);
  // Alone, so that discarded fragments do not happen at all; and beside one that keeps them all.
  for (const VoxelFormat format : kFormats) {
    VoxelizeRequest request = Request(GetParam(), Coverage::kThin, Layout::kInterleaved);
    request.targets = {TargetOf(format, 1, Blend::kFirst, {"base_color", {}})};
    request.targets[0].clear = 3;
    ASSERT_NO_FATAL_FAILURE(ExpectReference(soup, request));
    request.targets.push_back(TargetOf(VoxelFormat::kU32, 1, Blend::kCount, {"occupancy", {}}));
    ASSERT_NO_FATAL_FAILURE(ExpectReference(soup, request));
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, ValuesTest,
                         ::testing::Values(ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets),
                         [](const auto& test) { return std::string(Name(test.param)); });

uint32_t U32At(const HostBuffer& values, uint64_t i) {
  uint32_t v;
  std::memcpy(&v, values.data() + 4 * i, sizeof v);
  return v;
}
uint64_t U64At(const HostBuffer& values, uint64_t i) {
  uint64_t v;
  std::memcpy(&v, values.data() + 8 * i, sizeof v);
  return v;
}

TEST(Values, OfFillsAndClears) {
  TriangleMesh mesh = BumpySphere(8, 3);
  for (Vec3d& p : mesh.positions) p = Vec3d{p.x * 15 + 18, p.y * 6 + 5.5, p.z * 10 + 9};
  for (const Fill fill : {Fill::kParity, Fill::kFlood}) {
    VoxelizeRequest request = Request(ResultKind::kDense, Coverage::kThin, Layout::kPlanar);
    request.fill = fill;
    const VoxelizeResult filled = RunPipeline(mesh, request);
    const auto lists = FragmentLists(mesh, kDims, request.coverage);
    std::vector<bool> inside;
    for (uint64_t n = 0; n < lists.size(); ++n) inside.push_back(BitAt(filled.targets[0], n) && lists[n].empty());
    ASSERT_GT(std::count(inside.begin(), inside.end(), true), 300);
    const double numbers[] = {-0.0, 0.5, 2.5, -3, 255.5, 65519.999, 65520, 65535.5, 4294967295.5, 1e300, -1e300, 1e-8};
    size_t at = 0;
    for (const VoxelFormat format : kFormats) {
      request.targets.clear();
      for (int i = 0; i < 6; ++i) {
        request.targets.push_back(
            TargetOf(format, format == VoxelFormat::kBit ? 1 : 2, Blend::kReplace, {"triangle_id", {}}));
        request.targets.back().clear = numbers[at++ % std::size(numbers)];
        request.targets.back().fill_values = {numbers[at++ % std::size(numbers)]};
        if (at % std::size(numbers) == 0) ++at;
      }
      for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
        request.result = kind;
        ASSERT_NO_FATAL_FAILURE(ExpectReference(mesh, request, inside));
      }
    }
  }
}

TEST(Values, ReplaceKeepsTheLargestIdAndFirstTheSmallest) {
  const TriangleMesh soup = Soup(240, 20, 12);
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
    VoxelizeRequest request = Request(ResultKind::kDense, coverage, Layout::kInterleaved);
    request.targets = {TargetOf(VoxelFormat::kU32, 1, Blend::kReplace, {"triangle_id", {}}),
                       TargetOf(VoxelFormat::kU32, 1, Blend::kFirst, {"triangle_id", {}})};
    request.targets[0].clear = request.targets[1].clear = 99999;
    const VoxelizeResult result = RunPipeline(soup, request);
    const auto lists = FragmentLists(soup, kDims, coverage);
    for (uint64_t n = 0; n < lists.size(); ++n) {
      ASSERT_EQ(U32At(result.targets[0], n), lists[n].empty() ? 99999 : lists[n].back());
      ASSERT_EQ(U32At(result.targets[1], n), lists[n].empty() ? 99999 : lists[n].front());
    }
  }
}

TEST(Values, CountIsTheLengthOfTheBucket) {
  const TriangleMesh soup = Soup(240, 20, 13);
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
    VoxelizeRequest request = Request(ResultKind::kDense, coverage, Layout::kInterleaved);
    request.targets = {TargetOf(VoxelFormat::kU32, 1, Blend::kCount, {"constant", {{"value", {0}}}})};
    const VoxelizeResult counts = RunPipeline(soup, request);
    request.result = ResultKind::kBuckets;
    const VoxelizeResult buckets = RunPipeline(soup, request);
    std::vector<uint64_t> lengths(size_t(kDims[0] * kDims[1] * kDims[2]));
    for (uint64_t i = 0; i < buckets.listed_voxels(); ++i) {
      lengths[U64At(buckets.voxels, i)] = U64At(buckets.offsets, i + 1) - U64At(buckets.offsets, i);
    }
    for (uint64_t n = 0; n < lengths.size(); ++n) ASSERT_EQ(U32At(counts.targets[0], n), lengths[n]);
  }
}

// One voxel with `copies` of a triangle of one vertex colour.
uint32_t OneVoxel(const TargetSpec& target, float red, int copies) {
  const Vec3d a{0.2, 0.2, 0.5}, b{0.8, 0.2, 0.5}, c{0.2, 0.8, 0.5};
  TriangleMesh mesh = MakeMesh({a, b, c}, std::vector<std::array<uint32_t, 3>>(size_t(copies), {0, 1, 2}));
  mesh.colors.assign(3, Vec4f{red, 0, 0, 1});
  mesh.parts[0].has_colors = true;
  VoxelizeRequest request;
  request.grid = UnitGrid(1, 1, 1);
  request.targets = {target};
  const VoxelizeResult result = RunPipeline(mesh, request);
  uint32_t v = 0;
  std::memcpy(&v, result.targets.at(0).data(), result.targets[0].size());
  return v;
}

TEST(Values, ColoursFillTheRangeOf8And16Bits) {
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU8, 1, Blend::kMax, {"color", {}}), 1, 1), 255u);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU16, 1, Blend::kMax, {"color", {}}), 1, 1), 65535u);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU32, 1, Blend::kMax, {"color", {}}), 1, 1), 1u);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU8, 1, Blend::kMax, {"constant", {{"value", {1}}}}), 1, 1), 1u);
  TargetSpec scaled = TargetOf(VoxelFormat::kU8, 1, Blend::kMax, {"color", {}});
  scaled.scale = 10;
  EXPECT_EQ(OneVoxel(scaled, 0.25f, 1), 2u);  // 2.5
}

TEST(Values, SumsSaturateOnceAndAveragesNever) {
  const ShaderCall color{"color", {}};
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU8, 1, Blend::kAdd, color), 1, 300), 255u);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU16, 1, Blend::kAdd, color), 1, 300), 65535u);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU8, 1, Blend::kCount, color), 1, 300), 255u);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU16, 1, Blend::kCount, color), 1, 300), 300u);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU8, 1, Blend::kAverage, color), 0.5f, 300), 128u);  // 127.5 a fragment
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU32, 1, Blend::kAdd, color), 4e9f, 3), UINT32_MAX);
  EXPECT_EQ(OneVoxel(TargetOf(VoxelFormat::kU32, 1, Blend::kAverage, color), 4e9f, 3), 4000000000u);
}

TEST(Values, NanIsZeroInEveryFormat) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const VoxelFormat format : kFormats) {
    for (const Blend blend : kBlends) {
      if (!CheckBlend(format, blend).ok() || blend == Blend::kCount) continue;
      EXPECT_EQ(OneVoxel(TargetOf(format, 1, blend, {"color", {}}), nan, 3), 0u) << Name(format) << " " << Name(blend);
    }
  }
}

TEST(Values, RefuseNumbersThatNoFormatHolds) {
  for (const double bad : {double(INFINITY), -double(INFINITY), double(NAN)}) {
    for (const bool clear : {true, false}) {
      VoxelizeRequest request = Request(ResultKind::kDense, Coverage::kThin, Layout::kInterleaved);
      request.targets = {TargetSpec{}, TargetOf(VoxelFormat::kF32, 1, Blend::kMax, {"constant", {}})};
      clear ? void(request.targets[1].clear = bad) : void(request.targets[1].fill_values = {bad});
      const absl::Status s = RunError(Cube(4), request);
      EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
      EXPECT_NE(std::string(s.message()).find("targets[1]."), std::string::npos) << s;
    }
  }
}

}  // namespace
}  // namespace voxelpipe
