#include "wire/response.h"

#include <limits>
#include <string>

#include "gtest/gtest.h"
#include "wire/request.h"

namespace voxelpipe {
namespace {

GridSpec SampleGrid() {
  return {{7, 8, 9}, {-1.5, 0.1, 1e9}, {0.25, 0.5, 1e-3}};
}

TEST(ResponseTest, AGridSurvivesWithItsMatrix) {
  const GridSpec grid = SampleGrid();
  const v1::Grid message = ToMessage(grid);
  const auto back = FromMessage(message);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(*back, grid);
  ASSERT_EQ(message.index_to_world_size(), 16);
  EXPECT_EQ(message.index_to_world(0), 0.25);
  EXPECT_EQ(message.index_to_world(3), -1.5 + 0.125);  // the centre of voxel 0, not its corner
  EXPECT_EQ(message.index_to_world(5), 0.5);
  EXPECT_EQ(message.index_to_world(15), 1);
}

TEST(ResponseTest, AnImpossibleGridIsNotBelieved) {
  const auto refused = [](auto change) {
    v1::Grid message = ToMessage(SampleGrid());
    change(message);
    return FromMessage(message).status().code() == absl::StatusCode::kDataLoss;
  };
  EXPECT_FALSE(refused([](v1::Grid&) {}));
  EXPECT_TRUE(refused([](v1::Grid& g) { g.mutable_dims()->set_x(0); }));
  EXPECT_TRUE(refused([](v1::Grid& g) { g.mutable_dims()->set_z(-5); }));
  EXPECT_TRUE(refused([](v1::Grid& g) { g.mutable_dims()->set_y(std::numeric_limits<int64_t>::max()); }));
  EXPECT_TRUE(refused([](v1::Grid& g) { g.mutable_voxel_size()->set_x(0); }));
  EXPECT_TRUE(refused([](v1::Grid& g) { g.mutable_voxel_size()->set_y(std::numeric_limits<double>::quiet_NaN()); }));
  EXPECT_TRUE(refused([](v1::Grid& g) { g.mutable_origin()->set_z(std::numeric_limits<double>::infinity()); }));
  EXPECT_TRUE(refused([](v1::Grid& g) {
    for (auto set : {&v1::Dims::set_x, &v1::Dims::set_y, &v1::Dims::set_z}) (g.mutable_dims()->*set)(1 << 20);
  }));
}

TEST(ResponseTest, APlanSurvives) {
  for (const TimeClass time : {TimeClass::kInstant, TimeClass::kShort, TimeClass::kLong}) {
    const Plan plan{SampleGrid(), 63, uint64_t{1} << 40, "cpu", time, 8};
    const auto back = FromMessage(ToMessage(plan));
    ASSERT_TRUE(back.ok());
    EXPECT_EQ(back->grid, plan.grid);
    EXPECT_EQ(back->result_bytes, plan.result_bytes);
    EXPECT_EQ(back->peak_bytes, plan.peak_bytes);
    EXPECT_EQ(back->backend, plan.backend);
    EXPECT_EQ(back->time_class, plan.time_class);
    EXPECT_EQ(back->slab_depth, plan.slab_depth);
  }
}

TEST(ResponseTest, StatisticsSurvive) {
  VoxelizeStats stats;
  stats.triangles = 12;
  stats.fragments = uint64_t{1} << 33;
  stats.occupied = 5;
  stats.odd_columns = 0;  // 0 and absent differ
  stats.triangles_outside = 3;
  stats.backend = "cpu";
  stats.simd = "avx2";
  stats.path = {"occupancy", "owners in bricks"};
  stats.stages = {{"load", 1.5}, {"flatten", 0.25}, {"fine_raster", 3}};
  stats.voxelize_ms = 7.5;
  stats.voxelize_cpu_ms = 15;
  const VoxelizeStats back = FromMessage(ToMessage(stats));
  EXPECT_EQ(back.triangles, stats.triangles);
  EXPECT_EQ(back.fragments, stats.fragments);
  EXPECT_EQ(back.occupied, stats.occupied);
  EXPECT_EQ(back.odd_columns, stats.odd_columns);
  EXPECT_EQ(back.triangles_outside, 3u);
  EXPECT_EQ(back.backend, stats.backend);
  EXPECT_EQ(back.simd, stats.simd);
  EXPECT_EQ(back.path, stats.path);
  EXPECT_EQ(back.stages, stats.stages);
  EXPECT_EQ(back.voxelize_ms, stats.voxelize_ms);
  EXPECT_EQ(back.voxelize_cpu_ms, stats.voxelize_cpu_ms);
  stats.odd_columns.reset();
  EXPECT_FALSE(FromMessage(ToMessage(stats)).odd_columns.has_value());
}

TEST(ResponseTest, BackendsAndInstructionSetsAreNamed) {
  VoxelizeStats stats;
  stats.backend = "cuda";
  stats.simd = "cuda";  // a GPU has none
  const v1::VoxelizeStats message = ToMessage(stats);
  EXPECT_EQ(message.backend(), v1::BACKEND_CUDA);
  EXPECT_EQ(message.simd(), v1::SIMD_UNSPECIFIED);
  EXPECT_EQ(FromMessage(message).backend, "cuda");
  EXPECT_EQ(FromMessage(message).simd, "cuda");
  for (const char* simd : {"scalar", "avx2", "avx512"}) {
    stats.backend = "cpu";
    stats.simd = simd;
    EXPECT_EQ(FromMessage(ToMessage(stats)).simd, simd);
  }
  v1::VoxelizeStats newer;
  newer.set_backend(v1::Backend(99));
  EXPECT_EQ(FromMessage(newer).backend, "");
}

TEST(ResponseTest, CountsThatAreNegativeAreNone) {
  v1::VoxelizeStats stats;
  stats.set_triangles(-1);
  stats.set_fragments(std::numeric_limits<int64_t>::min());
  stats.set_occupied(-5);
  EXPECT_EQ(FromMessage(stats).triangles, 0u);
  EXPECT_EQ(FromMessage(stats).fragments, uint64_t{0});
  EXPECT_EQ(FromMessage(stats).occupied, 0u);
  v1::MeshReport report;
  report.set_vertices(-8);
  EXPECT_EQ(FromMessage(report).vertices, 0u);
}

TEST(ResponseTest, AMeshReportTellsOpenEdgesOnlyWhereTheyWereCounted) {
  const MeshReport report{12, 8, 1, 3, {-1, 0, 1}, {2, 3, 4}};
  const v1::MeshReport examined = ToMessage(report, true);
  const MeshReport back = FromMessage(examined);
  EXPECT_EQ(back.triangles, 12u);
  EXPECT_EQ(back.vertices, 8u);
  EXPECT_EQ(back.degenerate_triangles, 1u);
  EXPECT_EQ(back.open_edges, 3u);
  EXPECT_EQ(back.min, report.min);
  EXPECT_EQ(back.max, report.max);
  const v1::MeshReport unexamined = ToMessage(report, false);
  EXPECT_FALSE(unexamined.has_open_edges());
  EXPECT_FALSE(unexamined.has_degenerate_triangles());
}

TEST(ResponseTest, EveryShaderOfTheCatalogSurvives) {
  ASSERT_FALSE(ListShaders().empty());
  for (const ShaderInfo& info : ListShaders()) {
    const ShaderInfo back = FromMessage(ToMessage(info));
    EXPECT_EQ(back.name, info.name);
    EXPECT_EQ(back.stage, info.stage);
    EXPECT_EQ(back.description, info.description);
    EXPECT_EQ(back.output_type, info.output_type);
    EXPECT_EQ(back.output_components, info.output_components);
    EXPECT_EQ(back.reads_textures, info.reads_textures);
    ASSERT_EQ(back.parameters.size(), info.parameters.size());
    for (size_t i = 0; i < info.parameters.size(); ++i) {
      EXPECT_EQ(back.parameters[i].name, info.parameters[i].name);
      EXPECT_EQ(back.parameters[i].type, info.parameters[i].type);
      EXPECT_EQ(back.parameters[i].default_value, info.parameters[i].default_value);
      EXPECT_EQ(back.parameters[i].description, info.parameters[i].description);
    }
  }
}

// A request with a bit target and a planar colour, and what a server announces for it.
VoxelizeRequest Colours(ResultKind kind) {
  VoxelizeRequest request;
  request.result = kind;
  request.layout = Layout::kPlanar;
  request.targets.resize(2);
  request.targets[0].format = VoxelFormat::kF16;
  request.targets[0].components = 3;
  return request;
}

TEST(ResponseTest, AHeaderOfEveryKindSurvives) {
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
      for (const VoxelFormat format : {VoxelFormat::kBit, VoxelFormat::kU8, VoxelFormat::kU16, VoxelFormat::kU32,
                                       VoxelFormat::kF16, VoxelFormat::kF32}) {
        VoxelizeRequest request = Colours(kind);
        request.layout = layout;
        request.targets[0].format = format;
        if (format == VoxelFormat::kBit) request.targets[0].components = 1;
        const ResultHeader header = MakeResultHeader(request, SampleGrid(), 2, 17, 40);
        const auto back = FromMessage(ToMessage(header, request), request);
        ASSERT_TRUE(back.ok()) << back.status();
        EXPECT_EQ(back->kind, kind);
        EXPECT_EQ(back->grid, header.grid);
        EXPECT_EQ(back->layout, layout);
        EXPECT_EQ(back->arrays, header.arrays);
        EXPECT_EQ(ToMessage(header, request).spec().SerializeAsString(), MakeSpec(request).SerializeAsString());
      }
    }
  }
}

TEST(ResponseTest, AHeaderThatDiffersFromTheRequestIsNotBelieved) {
  const auto refused = [](ResultKind kind, auto change) {
    const VoxelizeRequest request = Colours(kind);
    v1::ResultHeader header = ToMessage(MakeResultHeader(request, SampleGrid(), 2, 17, 40), request);
    change(header);
    return FromMessage(header, request).status().code() == absl::StatusCode::kDataLoss;
  };
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
    SCOPED_TRACE(std::string(Name(kind)));
    EXPECT_FALSE(refused(kind, [](auto&) {}));
    EXPECT_TRUE(refused(kind, [](auto& h) { h.mutable_spec()->set_layout(v1::LAYOUT_INTERLEAVED); }));
    EXPECT_TRUE(refused(kind, [](auto& h) { h.mutable_spec()->set_result(v1::RESULT_KIND_UNSPECIFIED); }));
    EXPECT_TRUE(refused(kind, [](auto& h) { h.mutable_grid()->mutable_dims()->set_x(0); }));
    EXPECT_TRUE(refused(kind, [](auto& h) { h.clear_spec(); }));
    EXPECT_TRUE(refused(kind, [](auto& h) { h.clear_arrays(); }));
    EXPECT_TRUE(refused(kind, [](auto& h) { h.mutable_arrays()->RemoveLast(); }));
    EXPECT_TRUE(refused(kind, [](auto& h) { *h.add_arrays() = h.arrays(0); }));
    const int arrays = kind == ResultKind::kDense ? 2 : kind == ResultKind::kSparse ? 4 : 5;
    for (int i = 0; i < arrays; ++i) {
      SCOPED_TRACE(i);
      EXPECT_TRUE(refused(kind, [i](auto& h) { h.mutable_arrays(i)->set_name("other"); }));
      EXPECT_TRUE(refused(kind, [i](auto& h) { h.mutable_arrays(i)->set_element_type(v1::ElementType(99)); }));
      EXPECT_TRUE(refused(kind, [i](auto& h) { h.mutable_arrays(i)->clear_shape(); }));
      EXPECT_TRUE(refused(kind, [i](auto& h) { h.mutable_arrays(i)->add_shape(1); }));
      EXPECT_TRUE(refused(kind, [i](auto& h) { h.mutable_arrays(i)->set_shape(0, 1); }));
      EXPECT_TRUE(refused(kind, [i](auto& h) { h.mutable_arrays(i)->set_shape(0, -1); }));
    }
  }
}

// A request that cuts the mesh into parts, and the header of its result.
VoxelizeRequest WithParts(ResultKind kind, Fill fill) {
  VoxelizeRequest request = Colours(kind);
  request.fill = fill;
  request.parts.scope = PartScope::kNode;
  return request;
}
ResultHeader PartsHeader(const VoxelizeRequest& request, uint64_t parts, uint64_t name_bytes) {
  return MakeResultHeader(request, SampleGrid(), 2, 17, 40, {parts, FillsParts(request), name_bytes});
}

TEST(ResponseTest, TheArraysOfPartsComeBack) {
  for (const auto& [kind, fill] : {std::pair{ResultKind::kDense, Fill::kParity},
                                   {ResultKind::kSparse, Fill::kNonzero},
                                   {ResultKind::kBuckets, Fill::kNone},
                                   {ResultKind::kDense, Fill::kNone}}) {
    const VoxelizeRequest request = WithParts(kind, fill);
    for (const uint64_t parts : {uint64_t{0}, uint64_t{1}, uint64_t{65'535}}) {
      const ResultHeader header = PartsHeader(request, parts, parts == 1 ? 0 : 1000);
      const auto back = FromMessage(ToMessage(header, request), request);
      ASSERT_TRUE(back.ok()) << back.status();
      EXPECT_EQ(back->arrays, header.arrays);
      EXPECT_EQ(back->parts(), header.parts());
    }
  }
}

TEST(ResponseTest, ArraysOfPartsThatDifferFromTheRequestAreNotBelieved) {
  for (const Fill fill : {Fill::kNone, Fill::kParity}) {
    const VoxelizeRequest request = WithParts(ResultKind::kDense, fill);
    const v1::ResultHeader honest = ToMessage(PartsHeader(request, 3, 12), request);
    const auto refused = [&](const VoxelizeRequest& asked, auto change) {
      v1::ResultHeader header = honest;
      change(header);
      return FromMessage(header, asked).status().code() == absl::StatusCode::kDataLoss;
    };
    EXPECT_FALSE(refused(request, [](auto&) {}));
    VoxelizeRequest whole = request;
    whole.parts = {};
    EXPECT_TRUE(refused(whole, [](auto&) {})) << "parts that were not asked for";
    VoxelizeRequest other = request;
    other.fill = fill == Fill::kNone ? Fill::kParity : Fill::kNone;
    EXPECT_TRUE(refused(other, [](auto&) {})) << "counts of a fill";
    EXPECT_TRUE(refused(request, [](auto& h) { h.mutable_arrays()->RemoveLast(); }));
    EXPECT_TRUE(refused(request, [](auto& h) { *h.add_arrays() = h.arrays(2); }));
    for (int i = int(request.targets.size()); i < honest.arrays_size(); ++i) {
      SCOPED_TRACE(honest.arrays(i).name());
      EXPECT_TRUE(refused(request, [i](auto& h) { h.mutable_arrays(i)->set_name("other"); }));
      EXPECT_TRUE(refused(request, [i](auto& h) { h.mutable_arrays(i)->set_element_type(v1::ELEMENT_TYPE_F32); }));
      EXPECT_TRUE(refused(request, [i](auto& h) { h.mutable_arrays(i)->clear_shape(); }));
      EXPECT_TRUE(refused(request, [i](auto& h) { h.mutable_arrays(i)->add_shape(1); }));
      for (const int64_t size : {int64_t{-1}, int64_t{0}, INT64_MAX}) {
        const bool no_names = size == 0 && i + 1 == honest.arrays_size();
        EXPECT_NE(refused(request, [&](auto& h) { h.mutable_arrays(i)->set_shape(0, size); }), no_names) << size;
      }
    }
    EXPECT_TRUE(refused(request, [&](auto& h) { h = ToMessage(PartsHeader(request, 65'536, 12), request); }));
  }
}

TEST(ResponseTest, ListsThatTheGridCannotHoldAreNotBelieved) {
  // 7 x 8 x 9 voxels: 504, in two bricks.
  const auto believed = [](ResultKind kind, uint64_t bricks, uint64_t voxels, uint64_t fragments) {
    const VoxelizeRequest request = Colours(kind);
    const ResultHeader header = MakeResultHeader(request, SampleGrid(), bricks, voxels, fragments);
    return FromMessage(ToMessage(header, request), request).ok();
  };
  EXPECT_TRUE(believed(ResultKind::kSparse, 0, 0, 0));
  EXPECT_TRUE(believed(ResultKind::kSparse, 2, 504, 0));
  EXPECT_FALSE(believed(ResultKind::kSparse, 2, 505, 0));
  EXPECT_FALSE(believed(ResultKind::kSparse, 3, 504, 0));
  EXPECT_FALSE(believed(ResultKind::kSparse, 2, 1, 0)) << "a brick without a voxel";
  EXPECT_FALSE(believed(ResultKind::kSparse, UINT64_MAX, UINT64_MAX, 0));
  EXPECT_TRUE(believed(ResultKind::kBuckets, 0, 0, 0));
  EXPECT_TRUE(believed(ResultKind::kBuckets, 0, 504, 1 << 30));
  EXPECT_FALSE(believed(ResultKind::kBuckets, 0, 505, 505));
  EXPECT_FALSE(believed(ResultKind::kBuckets, 0, 504, 503)) << "a voxel without a fragment";
  EXPECT_FALSE(believed(ResultKind::kBuckets, 0, 504, uint64_t{1} << 62));
  EXPECT_FALSE(believed(ResultKind::kBuckets, 0, UINT64_MAX, UINT64_MAX));
}

}  // namespace
}  // namespace voxelpipe
