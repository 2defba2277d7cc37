// The header of a result says what was made, with every default filled in: sent again it gives the same bytes.
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {
namespace {

class ResolvedSpecTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = StartServer({"--log-level", "warn"});
    ASSERT_NE(server_, nullptr);
    stub_ = StubOf(*server_);
  }

  Received Make(const v1::VoxelizeSpec& spec) {
    v1::VoxelizeRequest request;
    *request.mutable_spec() = spec;
    SetFile(request, glb_);
    return Call(*stub_, request);
  }
  // Out: the resolved spec.
  v1::VoxelizeSpec ExpectSameAgain(const v1::VoxelizeSpec& spec) {
    SCOPED_TRACE(spec.ShortDebugString());
    const Received first = Make(spec);
    EXPECT_TRUE(first.status.ok()) << first.status.error_message();
    const v1::VoxelizeSpec& resolved = first.header.spec();
    const Received again = Make(resolved);
    EXPECT_TRUE(again.status.ok()) << again.status.error_message();
    EXPECT_FALSE(first.bytes.empty());
    EXPECT_TRUE(again.bytes == first.bytes);
    EXPECT_EQ(again.summary.content_sha256(), first.summary.content_sha256());
    EXPECT_EQ(again.header.SerializeAsString(), first.header.SerializeAsString()) << "grid, arrays and spec";
    EXPECT_NE(resolved.coverage(), v1::COVERAGE_UNSPECIFIED);
    EXPECT_NE(resolved.fill(), v1::FILL_UNSPECIFIED);
    EXPECT_NE(resolved.layout(), v1::LAYOUT_UNSPECIFIED);
    EXPECT_NE(resolved.result(), v1::RESULT_KIND_UNSPECIFIED);
    EXPECT_GT(resolved.targets_size(), 0);
    for (const v1::RenderTarget& target : resolved.targets()) {
      EXPECT_NE(target.format(), v1::VOXEL_FORMAT_UNSPECIFIED);
      EXPECT_NE(target.blend(), v1::BLEND_UNSPECIFIED);
      EXPECT_NE(target.encoding(), v1::ENCODING_UNSPECIFIED);
      EXPECT_TRUE(target.has_components());
      EXPECT_FALSE(target.shader().name().empty());
    }
    return resolved;
  }

  const std::vector<uint8_t> glb_ = TorusGlb(12);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
};

void Set(double x, double y, double z, v1::Vec3& out) {
  out.set_x(x);
  out.set_y(y);
  out.set_z(z);
}

v1::ShaderParameter& AddParameter(v1::ShaderCall& shader, const std::string& name, const std::vector<double>& values) {
  v1::ShaderParameter& parameter = *shader.add_parameters();
  parameter.set_name(name);
  parameter.mutable_numbers()->mutable_values()->Add(values.begin(), values.end());
  return parameter;
}

TEST_F(ResolvedSpecTest, OfAnEmptyRequest) {
  const v1::VoxelizeSpec resolved = ExpectSameAgain({});
  EXPECT_EQ(resolved.grid().resolution().voxels(), 128);
  EXPECT_EQ(resolved.grid().resolution().fit(), v1::GRID_FIT_TIGHT);
  ASSERT_EQ(resolved.targets_size(), 1);
  EXPECT_EQ(resolved.targets(0).format(), v1::VOXEL_FORMAT_BIT);
  EXPECT_EQ(resolved.targets(0).blend(), v1::BLEND_OR);
  EXPECT_EQ(resolved.targets(0).components(), 1);
  EXPECT_EQ(resolved.targets(0).shader().name(), "occupancy");
  EXPECT_EQ(resolved.result(), v1::RESULT_KIND_DENSE);
  EXPECT_EQ(resolved.layout(), v1::LAYOUT_INTERLEAVED);
}

// In the form that was asked for: the numbers are in the header's grid.
TEST_F(ResolvedSpecTest, OfAGridOfEveryForm) {
  v1::VoxelizeSpec cube;
  cube.mutable_grid()->mutable_resolution()->set_voxels(20);
  cube.mutable_grid()->mutable_resolution()->set_fit(v1::GRID_FIT_CUBE);
  cube.mutable_grid()->set_padding(2);
  v1::VoxelizeSpec resolved = ExpectSameAgain(cube);
  EXPECT_EQ(resolved.grid().SerializeAsString(), cube.grid().SerializeAsString());

  v1::VoxelizeSpec size;
  Set(0.1, 0.125, 0.3, *size.mutable_grid()->mutable_voxel_size());
  resolved = ExpectSameAgain(size);
  EXPECT_EQ(resolved.grid().form_case(), v1::GridRequest::kVoxelSize);
  EXPECT_EQ(resolved.grid().voxel_size().y(), 0.125);

  v1::VoxelizeSpec dims;
  dims.mutable_grid()->mutable_dims()->set_x(17);
  dims.mutable_grid()->mutable_dims()->set_y(30);
  dims.mutable_grid()->mutable_dims()->set_z(9);
  dims.mutable_grid()->set_padding(1);
  resolved = ExpectSameAgain(dims);
  EXPECT_EQ(resolved.grid().SerializeAsString(), dims.grid().SerializeAsString());

  v1::VoxelizeSpec placed;
  v1::GridPlacement& placement = *placed.mutable_grid()->mutable_placement();
  *placement.mutable_dims() = dims.grid().dims();
  Set(2.5, -3.0, 0.1, *placement.mutable_origin());
  Set(0.1, 0.1, 1.0 / 3, *placement.mutable_voxel_size());
  resolved = ExpectSameAgain(placed);
  EXPECT_EQ(resolved.grid().placement().SerializeAsString(), placement.SerializeAsString());
}

TEST_F(ResolvedSpecTest, OfShadersWithParameters) {
  v1::VoxelizeSpec spec;
  spec.mutable_grid()->mutable_resolution()->set_voxels(20);
  spec.mutable_vertex_shader()->set_name("transform");
  AddParameter(*spec.mutable_vertex_shader(), "matrix", {0.8, -0.6, 0, 1, 0.6, 0.8, 0, 2, 0, 0, 1.1, 3, 0, 0, 0, 1});
  for (const char* shader : {"normal", "base_color", "triangle_id", "barycentric"}) {
    v1::RenderTarget& target = *spec.add_targets();
    target.set_format(v1::VOXEL_FORMAT_F32);
    target.mutable_shader()->set_name(shader);  // its own number of components
  }
  v1::RenderTarget& constant = *spec.add_targets();
  constant.set_format(v1::VOXEL_FORMAT_F16);
  constant.mutable_shader()->set_name("constant");
  AddParameter(*constant.mutable_shader(), "value", {0.1, -0.5, 1.0 / 3});
  const v1::VoxelizeSpec resolved = ExpectSameAgain(spec);
  EXPECT_EQ(resolved.vertex_shader().SerializeAsString(), spec.vertex_shader().SerializeAsString());
  EXPECT_EQ(resolved.targets(0).components(), 3);
  EXPECT_EQ(resolved.targets(1).components(), 4);
  EXPECT_EQ(resolved.targets(4).shader().SerializeAsString(), constant.shader().SerializeAsString());
}

TEST_F(ResolvedSpecTest, OfFillsClearsScalesAndEncodings) {
  v1::VoxelizeSpec spec;
  spec.mutable_grid()->mutable_resolution()->set_voxels(24);
  spec.set_fill(v1::FILL_PARITY);
  spec.set_layout(v1::LAYOUT_PLANAR);
  v1::RenderTarget& filled = *spec.add_targets();
  filled.set_format(v1::VOXEL_FORMAT_F32);
  filled.mutable_shader()->set_name("normal");
  for (const double value : {0.5, -1.0, 7.0}) filled.add_fill(value);
  filled.set_clear(-0.25);
  v1::RenderTarget& colours = *spec.add_targets();
  colours.set_format(v1::VOXEL_FORMAT_U8);
  colours.set_encoding(v1::ENCODING_SRGB);
  colours.mutable_shader()->set_name("base_color");  // its own scale
  colours.add_fill(0);                               // 0 and none differ
  v1::RenderTarget& scaled = *spec.add_targets();
  scaled.set_format(v1::VOXEL_FORMAT_U16);
  scaled.set_blend(v1::BLEND_AVERAGE);
  scaled.set_scale(1000);
  scaled.set_quantum(0.25);
  scaled.mutable_shader()->set_name("barycentric");
  spec.add_targets()->set_blend(v1::BLEND_COUNT);
  const v1::VoxelizeSpec resolved = ExpectSameAgain(spec);
  ASSERT_EQ(resolved.targets(0).fill_size(), 3);
  EXPECT_EQ(resolved.targets(0).fill(2), 7);
  EXPECT_EQ(resolved.targets(0).clear(), -0.25);
  EXPECT_EQ(resolved.targets(1).fill_size(), 1);
  EXPECT_EQ(resolved.targets(1).encoding(), v1::ENCODING_SRGB);
  EXPECT_EQ(resolved.targets(2).scale(), 1000);
  EXPECT_EQ(resolved.targets(3).components(), 1);
}

TEST_F(ResolvedSpecTest, OfEveryKindOfResult) {
  for (const v1::ResultKind kind : {v1::RESULT_KIND_DENSE, v1::RESULT_KIND_SPARSE, v1::RESULT_KIND_BUCKETS}) {
    for (const v1::Coverage coverage : {v1::COVERAGE_CONSERVATIVE, v1::COVERAGE_THIN, v1::COVERAGE_CENTER}) {
      if (kind == v1::RESULT_KIND_BUCKETS && coverage == v1::COVERAGE_CENTER) continue;  // there is no such result
      if (kind == v1::RESULT_KIND_BUCKETS && coverage == v1::COVERAGE_CENTER) continue;  // which they do not take
      v1::VoxelizeSpec spec;
      spec.set_result(kind);
      spec.set_coverage(coverage);
      spec.set_strict(true);
      v1::RenderTarget& target = *spec.add_targets();
      target.set_format(v1::VOXEL_FORMAT_F32);
      target.mutable_shader()->set_name("normal");
      const v1::VoxelizeSpec resolved = ExpectSameAgain(spec);
      EXPECT_EQ(resolved.result(), kind);
      EXPECT_EQ(resolved.coverage(), coverage);
      EXPECT_TRUE(resolved.strict());
    }
  }
}

// The mesh of another request has its own grid by the same spec.
TEST_F(ResolvedSpecTest, IsTheSameWhateverTheMeshAndTheWayToRun) {
  v1::VoxelizeRequest request;
  request.mutable_spec()->mutable_grid()->mutable_resolution()->set_voxels(30);
  SetFile(request, glb_);
  const Received plain = Call(*stub_, request);
  request.mutable_execution()->set_simd(v1::SIMD_SCALAR);
  request.mutable_execution()->set_priority(v1::PRIORITY_LOW);
  request.mutable_delivery()->set_compression(v1::COMPRESSION_ZSTD);
  const Received scalar = Call(*stub_, request);
  SetFile(request, TorusGlb(8));
  const Received other = Call(*stub_, request);
  ASSERT_TRUE(plain.status.ok() && scalar.status.ok() && other.status.ok());
  EXPECT_EQ(scalar.header.SerializeAsString(), plain.header.SerializeAsString());
  EXPECT_EQ(scalar.summary.content_sha256(), plain.summary.content_sha256());
  EXPECT_EQ(other.header.spec().SerializeAsString(), plain.header.spec().SerializeAsString());
}

}  // namespace
}  // namespace voxelpipe::testing
