#include "wire/request.h"

#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe {
namespace {

// Over the wire and back, bytes included.
absl::StatusOr<ParsedConfig> RoundTrip(const VoxelizeRequest& request, MeshFileType format = {}) {
  v1::VoxelizeConfig received;
  EXPECT_TRUE(received.ParseFromString(MakeConfig(request, format).SerializeAsString()));
  return ParseConfig(received);
}

void ExpectEqual(const VoxelizeRequest& a, const VoxelizeRequest& b) {
  EXPECT_EQ(a.grid.resolution, b.grid.resolution);
  EXPECT_EQ(a.grid.fit, b.grid.fit);
  EXPECT_EQ(a.grid.voxel_size, b.grid.voxel_size);
  EXPECT_EQ(a.grid.dims, b.grid.dims);
  EXPECT_EQ(a.grid.origin, b.grid.origin);
  EXPECT_EQ(a.grid.padding, b.grid.padding);
  EXPECT_EQ(a.coverage, b.coverage);
  EXPECT_EQ(a.fill, b.fill);
  EXPECT_EQ(a.vertex_shader, b.vertex_shader);
  EXPECT_EQ(a.layout, b.layout);
  EXPECT_EQ(a.backend, b.backend);
  EXPECT_EQ(a.result, b.result);
  EXPECT_EQ(a.simd, b.simd);
  ASSERT_EQ(a.targets.size(), b.targets.size());
  for (size_t i = 0; i < a.targets.size(); ++i) {
    EXPECT_EQ(a.targets[i].format, b.targets[i].format);
    EXPECT_EQ(a.targets[i].components, b.targets[i].components);
    EXPECT_EQ(a.targets[i].blend, b.targets[i].blend);
    EXPECT_EQ(a.targets[i].shader, b.targets[i].shader);
    EXPECT_EQ(a.targets[i].quantum, b.targets[i].quantum);
    EXPECT_EQ(a.targets[i].scale, b.targets[i].scale);
    EXPECT_EQ(a.targets[i].clear, b.targets[i].clear);
    EXPECT_EQ(a.targets[i].fill_values, b.targets[i].fill_values);
    EXPECT_EQ(a.targets[i].encoding, b.targets[i].encoding);
  }
}

TEST(RequestTest, AnEmptyConfigIsTheDefaultRequest) {
  const auto parsed = ParseConfig(v1::VoxelizeConfig());
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  ExpectEqual(parsed->request, VoxelizeRequest());
  EXPECT_EQ(parsed->mesh_type.format, MeshFormat::kAuto);
  EXPECT_TRUE(ValidateRequest(parsed->request).ok());
}

TEST(RequestTest, EverythingOfARequestSurvives) {
  VoxelizeRequest request;
  request.grid.resolution = 77;
  request.grid.fit = GridFit::kCube;
  request.grid.padding = 3;
  request.coverage = Coverage::kThin;
  request.fill = Fill::kParity;
  request.vertex_shader = {"transform", {{"matrix", {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}}}};
  request.layout = Layout::kPlanar;
  request.backend = BackendChoice::kCpu;
  TargetSpec first;
  first.blend = Blend::kReplace;
  TargetSpec second;
  second.format = VoxelFormat::kF32;
  second.components = 3;
  second.blend = Blend::kAdd;
  second.shader = {"constant", {{"value", {0.1, -0.0, 1e300}}}, {{"name", "_HEAT"}, {"empty", ""}}};
  second.quantum = 0.25;
  second.clear = -1.5;
  second.fill_values = {0, 0.5, 7};
  second.scale = 0;  // 0 and absent differ
  request.targets = {first, second};
  const auto parsed = RoundTrip(request, MeshFormat::kDraco);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  ExpectEqual(parsed->request, request);
  EXPECT_EQ(parsed->mesh_type.format, MeshFormat::kDraco);
}

TEST(RequestTest, EveryEnumeratorSurvives) {
  for (const MeshFormat format :
       {MeshFormat::kAuto, MeshFormat::kGlb, MeshFormat::kGltf, MeshFormat::kDraco, MeshFormat::kStl, MeshFormat::kPly,
        MeshFormat::kOff, MeshFormat::kObj, MeshFormat::k3mf}) {
    EXPECT_EQ(RoundTrip(VoxelizeRequest(), format)->mesh_type.format, format);
  }
  for (const LengthUnit unit :
       {LengthUnit::kNone, LengthUnit::kMillimetre, LengthUnit::kCentimetre, LengthUnit::kMetre, LengthUnit::kInch}) {
    EXPECT_EQ(RoundTrip(VoxelizeRequest(), {MeshFormat::kStl, unit})->mesh_type.unit, unit);
  }
  VoxelizeRequest request;
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter, Coverage::kNone}) {
    request.coverage = coverage;
    EXPECT_EQ(RoundTrip(request)->request.coverage, coverage);
  }
  for (const BackendChoice backend : {BackendChoice::kAuto, BackendChoice::kCpu, BackendChoice::kCuda}) {
    request.backend = backend;
    EXPECT_EQ(RoundTrip(request)->request.backend, backend);
  }
  for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood, Fill::kNonzero}) {
    request.fill = fill;
    EXPECT_EQ(RoundTrip(request)->request.fill, fill);
  }
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    request.result = kind;
    EXPECT_EQ(RoundTrip(request)->request.result, kind);
  }
  for (const SimdChoice simd : {SimdChoice::kAuto, SimdChoice::kScalar, SimdChoice::kAvx2, SimdChoice::kAvx512}) {
    request.simd = simd;
    EXPECT_EQ(RoundTrip(request)->request.simd, simd);
  }
  for (const VoxelFormat format : {VoxelFormat::kBit, VoxelFormat::kU8, VoxelFormat::kU16, VoxelFormat::kU32,
                                   VoxelFormat::kF16, VoxelFormat::kF32}) {
    request.targets[0].format = format;
    EXPECT_EQ(RoundTrip(request)->request.targets[0].format, format);
  }
  for (const Blend blend : {Blend::kOr, Blend::kReplace, Blend::kMin, Blend::kMax, Blend::kAdd, Blend::kFirst,
                            Blend::kAverage, Blend::kCount, Blend::kAnd}) {
    request.targets[0].blend = blend;
    EXPECT_EQ(RoundTrip(request)->request.targets[0].blend, blend);
  }
}

TEST(RequestTest, HowToServeSurvives) {
  CallSettings settings;
  settings.compression = Compression::kZstd;
  settings.priority = Priority::kLow;
  settings.fallback = false;
  settings.queue_timeout = std::chrono::milliseconds(0);  // 0 and absent differ
  settings.content_hash = false;
  const auto parsed = ParseConfig(MakeConfig(VoxelizeRequest(), MeshFormat::kAuto, settings));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->settings.compression, Compression::kZstd);
  EXPECT_EQ(parsed->settings.priority, Priority::kLow);
  EXPECT_EQ(parsed->settings.fallback, false);
  EXPECT_EQ(parsed->settings.queue_timeout, std::chrono::milliseconds(0));
  EXPECT_FALSE(parsed->settings.content_hash);

  const auto plain = ParseConfig(v1::VoxelizeConfig());
  ASSERT_TRUE(plain.ok());
  EXPECT_EQ(plain->settings.compression, Compression::kNone);
  EXPECT_EQ(plain->settings.priority, Priority::kNormal);
  EXPECT_FALSE(plain->settings.fallback.has_value());
  EXPECT_FALSE(plain->settings.queue_timeout.has_value());
  EXPECT_TRUE(plain->settings.content_hash);
}

TEST(RequestTest, AnExplicitGridSurvives) {
  VoxelizeRequest request;
  request.grid.voxel_size = Vec3d{0.5, 0.25, 0.125};
  ExpectEqual(RoundTrip(request)->request, request);
  request.grid.dims = {3, 4, 5};
  request.grid.origin = Vec3d{-1, 2, 1e-9};
  ExpectEqual(RoundTrip(request)->request, request);
}

TEST(RequestTest, WhatIsNotAllowedReachesTheCheckThatRefusesIt) {
  VoxelizeRequest request;
  request.targets[0].components = 0;
  const auto parsed = RoundTrip(request);
  ASSERT_TRUE(parsed.ok());
  EXPECT_EQ(parsed->request.targets[0].components, 0);
}

TEST(RequestTest, TheComponentsDefaultFollowsTheShader) {
  v1::VoxelizeConfig config;
  for (const char* shader : {"base_color", "normal", "uv", "attribute", "triangle_id"}) {
    v1::RenderTarget* target = config.add_targets();
    target->set_format(v1::VOXEL_FORMAT_U8);
    target->mutable_shader()->set_name(shader);
  }
  config.mutable_targets(2)->set_blend(v1::BLEND_COUNT);
  config.add_targets()->mutable_shader()->set_name("normal");  // bit
  config.add_targets()->set_format(v1::VOXEL_FORMAT_F32);      // occupancy
  const auto parsed = ParseConfig(config);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  std::vector<int> components;
  for (const TargetSpec& target : parsed->request.targets) components.push_back(target.components);
  EXPECT_EQ(components, (std::vector<int>{4, 3, 1, 4, 1, 1, 1}));
}

TEST(RequestTest, FillNumbersAndEncodingSurvive) {
  VoxelizeRequest request;
  request.coverage = Coverage::kNone;
  request.fill = Fill::kNonzero;
  TargetSpec target;
  target.format = VoxelFormat::kU8;
  target.components = 4;
  target.blend = Blend::kAverage;
  target.shader.name = "base_color";
  target.encoding = Encoding::kSrgb;
  request.targets.clear();
  for (const std::vector<double>& fill : {std::vector<double>{}, {0}, {7.5}, {1, 2, 3, 4}}) {
    target.fill_values = fill;
    request.targets.push_back(target);
  }
  target.encoding = Encoding::kSnorm;
  target.shader.name = "normal";
  request.targets.push_back(target);
  ExpectEqual(RoundTrip(request)->request, request);
  v1::VoxelizeConfig config;
  config.add_targets()->set_fill_value(1);
  config.mutable_targets(0)->add_fill_values(1);
  const std::string message(ParseConfig(config).status().message());
  EXPECT_NE(message.find("targets[0].fill_values"), std::string::npos) << message;
}

TEST(RequestTest, TheBlendsDefaultFollowsTheFormat) {
  v1::VoxelizeConfig config;
  config.add_targets();
  config.add_targets()->set_format(v1::VOXEL_FORMAT_F32);
  const auto parsed = ParseConfig(config);
  ASSERT_TRUE(parsed.ok());
  EXPECT_EQ(parsed->request.targets[0].blend, Blend::kOr);
  EXPECT_EQ(parsed->request.targets[1].blend, Blend::kReplace);
  EXPECT_TRUE(ValidateRequest(parsed->request).ok());
}

// Each change makes a config that must be refused with a message that begins with `field`.
template <typename Change>
void ExpectRefused(const std::string& field, Change change) {
  v1::VoxelizeConfig config;
  change(config);
  const absl::Status status = ParseConfig(config).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << field;
  EXPECT_TRUE(std::string(status.message()).starts_with(field + ": ")) << status;
}

TEST(RequestTest, ValuesOfNewerClientsAreRefusedByField) {
  ExpectRefused("mesh_format", [](auto& c) { c.set_mesh_format(v1::MeshFormat(99)); });
  ExpectRefused("mesh_unit", [](auto& c) { c.set_mesh_unit(v1::LengthUnit(99)); });
  ExpectRefused("mesh_unit", [](auto& c) {
    c.set_mesh_unit(v1::LENGTH_UNIT_METRE);
    c.set_mesh_id(std::string(64, 'a'));
  });
  ExpectRefused("grid.fit", [](auto& c) { c.mutable_grid()->set_fit(v1::GridFit(3)); });
  ExpectRefused("coverage", [](auto& c) { c.set_coverage(v1::Coverage(5)); });
  ExpectRefused("fill", [](auto& c) { c.set_fill(v1::Fill(5)); });
  ExpectRefused("layout", [](auto& c) { c.set_layout(v1::Layout(-1)); });
  ExpectRefused("backend", [](auto& c) { c.set_backend(v1::Backend(4)); });
  ExpectRefused("result", [](auto& c) { c.set_result(v1::ResultKind(4)); });
  ExpectRefused("simd", [](auto& c) { c.set_simd(v1::Simd(5)); });
  ExpectRefused("compression", [](auto& c) { c.set_compression(v1::Compression(3)); });
  ExpectRefused("priority", [](auto& c) { c.set_priority(v1::Priority(4)); });
  ExpectRefused("targets[1].format", [](auto& c) {
    c.add_targets();
    c.add_targets()->set_format(v1::VoxelFormat(7));
  });
  ExpectRefused("targets[0].blend", [](auto& c) { c.add_targets()->set_blend(v1::Blend(10)); });
}

TEST(RequestTest, ContradictionsAreRefusedByField) {
  ExpectRefused("queue_timeout_ms", [](auto& c) { c.set_queue_timeout_ms(-1); });
  ExpectRefused("new_positions", [](auto& c) { c.set_new_positions(true); });
  ExpectRefused("grid.resolution", [](auto& c) {
    c.mutable_grid()->set_resolution(8);
    c.mutable_grid()->mutable_voxel_size()->set_x(1);
  });
  ExpectRefused("grid.resolution", [](auto& c) {
    c.mutable_grid()->set_resolution(8);
    c.mutable_grid()->mutable_dims();
  });
  ExpectRefused("vertex_shader", [](auto& c) {
    c.mutable_vertex_shader()->add_parameters()->set_name("matrix");
    c.mutable_vertex_shader()->add_parameters()->set_name("matrix");
  });
  ExpectRefused("targets[0].shader", [](auto& c) {
    v1::ShaderParameter* parameter = c.add_targets()->mutable_shader()->add_parameters();
    parameter->set_text("both");
    parameter->add_values(1);
  });
  ExpectRefused("vertex_shader", [](auto& c) {
    c.mutable_vertex_shader()->add_parameters()->set_text("one");
    c.mutable_vertex_shader()->add_parameters()->add_values(1);
  });
  ExpectRefused("targets", [](auto& c) {
    for (int i = 0; i <= kMaxTargets; ++i) c.add_targets();
  });
}

}  // namespace
}  // namespace voxelpipe
