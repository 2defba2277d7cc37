#include "wire/request.h"

#include <cmath>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "pipeline/plan/plan.h"
#include "wire/placed.h"

namespace voxelpipe {
namespace {

// Over the wire and back, bytes included.
absl::StatusOr<ParsedConfig> RoundTrip(const VoxelizeRequest& request, const MeshFileType& type = {}) {
  v1::VoxelizeRequest sent = MakeRequest(request), received;
  WriteTo(type, *sent.mutable_mesh()->mutable_bytes());
  EXPECT_TRUE(received.ParseFromString(sent.SerializeAsString()));
  return ParseRequest(received);
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
  EXPECT_EQ(a.parts, b.parts);
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

TEST(RequestTest, AnEmptyMessageIsTheDefaultRequest) {
  const auto parsed = ParseRequest(v1::VoxelizeRequest());
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  ExpectEqual(parsed->request, VoxelizeRequest());
  EXPECT_EQ(parsed->mesh_type.format, MeshFormat::kAuto);
  EXPECT_EQ(parsed->mesh_name, "");
  EXPECT_FALSE(parsed->new_positions);
  EXPECT_TRUE(parsed->default_targets);
  EXPECT_TRUE(parsed->default_result);
  EXPECT_TRUE(ValidateRequest(parsed->request).ok());
}

TEST(RequestTest, AStoredMeshIsNamedAndMayHaveNewPositions) {
  v1::VoxelizeRequest message;
  message.mutable_mesh()->mutable_stored()->set_name("meshes/a");
  const auto plain = ParseRequest(message);
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_EQ(plain->mesh_name, "meshes/a");
  EXPECT_FALSE(plain->new_positions);
  message.mutable_mesh()->mutable_stored()->mutable_positions();  // they come in pieces
  const auto moved = ParseRequest(message);
  ASSERT_TRUE(moved.ok()) << moved.status();
  EXPECT_EQ(moved->mesh_name, "meshes/a");
  EXPECT_TRUE(moved->new_positions);
}

TEST(RequestTest, PlacedMeshesComeWithTheirDefaults) {
  const std::string a = "meshes/" + std::string(64, 'a'), b = "meshes/" + std::string(64, 'b') + "-mm";
  v1::VoxelizeRequest message;
  v1::PlacedMeshes& list = *message.mutable_mesh()->mutable_placed();
  list.add_meshes()->set_mesh(a);
  v1::PlacedMesh& second = *list.add_meshes();
  second.set_mesh(b);
  for (int i = 0; i < 16; ++i) second.add_matrix(i % 5 == 0 ? 1 : -0.0);
  second.mutable_motion()->mutable_angular()->set_z(-2);
  const auto parsed = ParseRequest(message);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->mesh_name, "");
  ASSERT_TRUE(parsed->placed);
  ASSERT_EQ(parsed->placed->size(), 2u);
  const PlacedStored& one = parsed->placed->front();
  const PlacedStored& two = parsed->placed->back();
  EXPECT_EQ(one.mesh, a);
  EXPECT_EQ(one.name, a);
  EXPECT_EQ(one.label, 1u);
  EXPECT_EQ(one.priority, 0);
  EXPECT_EQ(one.motion, std::nullopt);
  EXPECT_EQ(one.matrix, Mat4d());
  EXPECT_EQ(two.label, 2u);
  EXPECT_EQ(two.motion, (RigidMotionNumbers{{}, {0, 0, -2}, {}}));
  EXPECT_EQ(two.matrix, Mat4d());
  EXPECT_FALSE(std::signbit(two.matrix.m[0][1])) << "-0 is 0";
}

TEST(RequestTest, EverythingOfPlacedMeshesSurvives) {
  const std::string a = "meshes/" + std::string(64, 'a');
  Mat4d matrix;
  for (int i = 0; i < 12; ++i) matrix.m[i / 4][i % 4] = 0.1 * i * i - 1;
  const std::vector<PlacedStored> sent{{a, matrix, "one", 4'000'000'000u, -7, RigidMotionNumbers{{1, 2, 3}, {4}, {5}}},
                                       {a, Mat4d(), "two", 1u, 0, {}}};
  v1::PlacedMeshes message;
  WriteTo(sent, message);
  const auto read = ParsePlaced(message);
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), sent.size());
  for (size_t i = 0; i < sent.size(); ++i) {
    EXPECT_EQ((*read)[i].mesh, sent[i].mesh);
    EXPECT_EQ((*read)[i].matrix, sent[i].matrix);
    EXPECT_EQ((*read)[i].name, sent[i].name);
    EXPECT_EQ((*read)[i].label, sent[i].label);
    EXPECT_EQ((*read)[i].priority, sent[i].priority);
    EXPECT_EQ((*read)[i].motion, sent[i].motion);
  }
}

// The header of a result returns the spec with every default filled in: sent again it is the same request.
TEST(RequestTest, AResolvedSpecIsTheSameRequest) {
  std::vector<v1::VoxelizeSpec> specs(6);
  specs[1].mutable_grid()->mutable_resolution()->set_fit(v1::GRID_FIT_CUBE);
  specs[2].mutable_grid()->mutable_dims()->set_x(3);
  specs[2].mutable_grid()->set_padding(2);
  specs[3].mutable_grid()->mutable_voxel_size()->set_y(0.1);
  v1::GridPlacement& placement = *specs[4].mutable_grid()->mutable_placement();
  placement.mutable_dims()->set_z(7);
  placement.mutable_origin()->set_x(-1e-9);
  placement.mutable_voxel_size()->set_x(0.1);
  specs[5].mutable_vertex_shader()->set_name("transform");
  v1::RenderTarget& target = *specs[5].add_targets();
  target.set_format(v1::VOXEL_FORMAT_U8);
  target.mutable_shader()->set_name("constant");
  target.mutable_shader()->add_parameters()->set_name("value");
  target.mutable_shader()->mutable_parameters(0)->mutable_numbers()->add_values(0.1);
  target.add_fill(0.3);
  target.set_scale(0);
  target.set_quantum(0.5);
  specs[5].add_targets()->set_blend(v1::BLEND_COUNT);
  for (const v1::VoxelizeSpec& spec : specs) {
    const auto parsed = ParseRequest(spec, {});
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    const v1::VoxelizeSpec resolved = MakeSpec(parsed->request);
    EXPECT_EQ(resolved.grid().form_case(),
              spec.grid().form_case() == 0 ? v1::GridRequest::kResolution : spec.grid().form_case());
    EXPECT_GT(resolved.targets_size(), 0);
    const auto again = ParseRequest(resolved, {});
    ASSERT_TRUE(again.ok()) << again.status();
    ExpectEqual(again->request, parsed->request);
    EXPECT_EQ(MakeSpec(again->request).SerializeAsString(), resolved.SerializeAsString());
  }
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
  request.parts.scope = PartScope::kMesh;
  request.parts.labels = {{"a*", 1}, {"", UINT32_MAX}, {"a*", 2}};
  request.parts.priorities = {{"b", INT32_MIN}, {"c", INT32_MAX}};
  request.parts.exclude = {"", "d=?"};
  const auto parsed = RoundTrip(request, MeshFormat::kDraco);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  ExpectEqual(parsed->request, request);
  EXPECT_EQ(parsed->mesh_type.format, MeshFormat::kDraco);
}

TEST(RequestTest, WhatIsWrongWithPartsIsNamed) {
  const auto error = [](const v1::PartSelection& parts) {
    v1::VoxelizeRequest message;
    *message.mutable_spec()->mutable_parts() = parts;
    const absl::Status status = ParseRequest(message).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  v1::PartSelection parts;
  parts.add_exclude("a");
  EXPECT_EQ(error(parts), "parts.exclude: needs parts.scope: file, node, mesh or material");
  parts.set_scope(v1::PartScope(99));
  EXPECT_EQ(error(parts), "parts.scope: this server does not know the value 99");
  parts.set_scope(v1::PART_SCOPE_NODE);
  parts.add_labels()->set_number(1);
  parts.add_labels();
  EXPECT_EQ(error(parts), "parts.labels[1].number: 0 is not a whole number from 1 to 4294967295");
  parts.clear_labels();
  parts.add_priorities()->set_number(int64_t{INT32_MIN} - 1);
  EXPECT_EQ(error(parts),
            "parts.priorities[0].number: -2147483649 is not a whole number from -2147483648 to 2147483647");
  parts.clear_priorities();
  for (int i = 0; i < 1000; ++i) parts.add_exclude("b");
  EXPECT_EQ(error(parts), "parts.exclude: at most 1000 are possible, 1001 given");
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
  for (const PartScope scope :
       {PartScope::kWhole, PartScope::kFile, PartScope::kNode, PartScope::kMesh, PartScope::kMaterial}) {
    request.parts.scope = scope;
    EXPECT_EQ(RoundTrip(request)->request.parts.scope, scope);
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
  settings.single_message_bytes = 0;  // as well
  const auto parsed = ParseRequest(MakeRequest(VoxelizeRequest(), settings));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->settings.compression, Compression::kZstd);
  EXPECT_EQ(parsed->settings.priority, Priority::kLow);
  EXPECT_EQ(parsed->settings.fallback, false);
  EXPECT_EQ(parsed->settings.queue_timeout, std::chrono::milliseconds(0));
  EXPECT_FALSE(parsed->settings.content_hash);
  EXPECT_EQ(parsed->settings.single_message_bytes, 0);

  const auto plain = ParseRequest(v1::VoxelizeRequest());
  ASSERT_TRUE(plain.ok());
  EXPECT_EQ(plain->settings.compression, Compression::kNone);
  EXPECT_EQ(plain->settings.priority, Priority::kNormal);
  EXPECT_FALSE(plain->settings.fallback.has_value());
  EXPECT_FALSE(plain->settings.queue_timeout.has_value());
  EXPECT_TRUE(plain->settings.content_hash);
  EXPECT_FALSE(plain->settings.single_message_bytes.has_value());
}

TEST(RequestTest, AnExplicitGridSurvives) {
  VoxelizeRequest request;
  request.grid.voxel_size = Vec3d{0.5, 0.25, 0.125};
  ExpectEqual(RoundTrip(request)->request, request);
  request.grid.dims = {3, 4, 5};
  request.grid.origin = Vec3d{-1, 2, 1e-9};
  ExpectEqual(RoundTrip(request)->request, request);
  request.grid.voxel_size.reset();
  request.grid.origin.reset();
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
  v1::VoxelizeSpec spec;
  for (const char* shader : {"base_color", "normal", "uv", "attribute", "triangle_id"}) {
    v1::RenderTarget* target = spec.add_targets();
    target->set_format(v1::VOXEL_FORMAT_U8);
    target->mutable_shader()->set_name(shader);
  }
  spec.mutable_targets(2)->set_blend(v1::BLEND_COUNT);
  spec.add_targets()->mutable_shader()->set_name("normal");  // bit
  spec.add_targets()->set_format(v1::VOXEL_FORMAT_F32);      // occupancy
  const auto parsed = ParseRequest(spec, {});
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
}

TEST(RequestTest, TheBlendsDefaultFollowsTheFormat) {
  v1::VoxelizeSpec spec;
  spec.add_targets();
  spec.add_targets()->set_format(v1::VOXEL_FORMAT_F32);
  const auto parsed = ParseRequest(spec, {});
  ASSERT_TRUE(parsed.ok());
  EXPECT_EQ(parsed->request.targets[0].blend, Blend::kOr);
  EXPECT_EQ(parsed->request.targets[1].blend, Blend::kReplace);
  EXPECT_TRUE(ValidateRequest(parsed->request).ok());
}

// Each change makes a request that must be refused with a message that begins with `field`.
template <typename Change>
void ExpectRefused(const std::string& field, Change change) {
  v1::VoxelizeRequest request;
  change(request);
  const absl::Status status = ParseRequest(request).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << field;
  EXPECT_TRUE(std::string(status.message()).starts_with(field + ": ")) << status;
}
// The same of its spec.
template <typename Change>
void ExpectSpecRefused(const std::string& field, Change change) {
  ExpectRefused(field, [&](auto& r) { change(*r.mutable_spec()); });
}

TEST(RequestTest, ValuesOfNewerClientsAreRefusedByField) {
  ExpectRefused("mesh.bytes.format",
                [](auto& r) { r.mutable_mesh()->mutable_bytes()->set_format(v1::MeshFormat(99)); });
  ExpectRefused("mesh.bytes.unit", [](auto& r) { r.mutable_mesh()->mutable_bytes()->set_unit(v1::LengthUnit(99)); });
  ExpectSpecRefused("grid.fit", [](auto& s) { s.mutable_grid()->mutable_resolution()->set_fit(v1::GridFit(3)); });
  ExpectSpecRefused("coverage", [](auto& s) { s.set_coverage(v1::Coverage(5)); });
  ExpectSpecRefused("fill", [](auto& s) { s.set_fill(v1::Fill(5)); });
  ExpectSpecRefused("layout", [](auto& s) { s.set_layout(v1::Layout(-1)); });
  ExpectRefused("backend", [](auto& r) { r.mutable_execution()->set_backend(v1::Backend(4)); });
  ExpectSpecRefused("result", [](auto& s) { s.set_result(v1::ResultKind(4)); });
  ExpectRefused("simd", [](auto& r) { r.mutable_execution()->set_simd(v1::Simd(5)); });
  ExpectRefused("compression", [](auto& r) { r.mutable_delivery()->set_compression(v1::Compression(3)); });
  ExpectRefused("priority", [](auto& r) { r.mutable_execution()->set_priority(v1::Priority(4)); });
  ExpectSpecRefused("targets[1].format", [](auto& s) {
    s.add_targets();
    s.add_targets()->set_format(v1::VoxelFormat(7));
  });
  ExpectSpecRefused("targets[0].blend", [](auto& s) { s.add_targets()->set_blend(v1::Blend(10)); });
  ExpectSpecRefused("targets[0].encoding", [](auto& s) { s.add_targets()->set_encoding(v1::Encoding(4)); });
}

TEST(RequestTest, ContradictionsAreRefusedByField) {
  ExpectRefused("queue_timeout", [](auto& r) { r.mutable_execution()->mutable_queue_timeout()->set_seconds(-1); });
  ExpectRefused("queue_timeout", [](auto& r) { r.mutable_execution()->mutable_queue_timeout()->set_nanos(-1); });
  ExpectRefused("single_message_bytes", [](auto& r) { r.mutable_delivery()->set_single_message_bytes(-1); });
  ExpectRefused("mesh.stored.name", [](auto& r) { r.mutable_mesh()->mutable_stored(); });
  ExpectRefused("mesh.stored.name", [](auto& r) { r.mutable_mesh()->mutable_stored()->mutable_positions(); });
  ExpectSpecRefused("grid.placement", [](auto& s) { s.mutable_grid()->mutable_placement(); });
  ExpectSpecRefused("grid.placement", [](auto& s) {
    s.mutable_grid()->mutable_placement()->mutable_dims();
    s.mutable_grid()->mutable_placement()->mutable_voxel_size();
  });
  ExpectSpecRefused("vertex_shader", [](auto& s) {
    s.mutable_vertex_shader()->add_parameters()->set_name("matrix");
    s.mutable_vertex_shader()->add_parameters()->set_name("matrix");
  });
  ExpectSpecRefused("targets[0].shader", [](auto& s) {
    v1::ShaderCall& shader = *s.add_targets()->mutable_shader();
    shader.add_parameters()->set_text("one");
    shader.add_parameters()->mutable_numbers()->add_values(1);
  });
  ExpectSpecRefused("targets", [](auto& s) {
    for (int i = 0; i <= kMaxTargets; ++i) s.add_targets();
  });
}

}  // namespace
}  // namespace voxelpipe
