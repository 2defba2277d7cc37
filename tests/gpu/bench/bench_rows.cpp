#include "gpu/bench/bench_rows.h"

#include <utility>

#include "gpu/cases/bench_meshes.h"

namespace voxelpipe::gpu {
namespace {

VoxelizeRequest Bits(Coverage coverage) {
  VoxelizeRequest request;
  request.coverage = coverage;
  return request;
}

// `components` floats a voxel: the triangle's id where one does, its normal where there are four.
VoxelizeRequest Floats(int components, Blend blend, ResultKind kind) {
  VoxelizeRequest request;
  TargetSpec& target = request.targets[0];
  target.format = VoxelFormat::kF32;
  target.components = components;
  target.blend = blend;
  target.shader = {components == 1 ? "triangle_id" : "normal", {}};
  request.result = kind;
  return request;
}

VoxelizeRequest ABuffer(Coverage coverage) {
  VoxelizeRequest request = Bits(coverage);
  request.result = ResultKind::kBuckets;
  return request;
}

class Rows {
 public:
  void Add(const char* mesh, const char* name, int64_t n, double pass_ms, double stretch_ms, VoxelizeRequest request) {
    request.grid = UnitCube(n);
    request.backend = BackendChoice::kCuda;
    rows_.push_back({mesh, name, n, pass_ms, stretch_ms, std::move(request)});
  }
  std::vector<BenchRow> Take() { return std::move(rows_); }

 private:
  std::vector<BenchRow> rows_;
};

struct Times {
  const char* mesh;
  double pass_ms[4], stretch_ms[4];  // at 128, 512, 1024, 2048
};
constexpr Times kConservativeBits[] = {
    {"cow", {.025, .040, .085, .37}, {.012, .020, .055, .28}},
    {"bunny", {.017, .040, .13, .62}, {.012, .022, .075, .38}},
    {"bunny1M", {.050, .065, .16, .68}, {.025, .040, .10, .45}},
    {"sphere10M", {.25, .34, .46, 1.0}, {.12, .20, .30, .75}},
    {"nasty", {.085, .12, .42, 1.8}, {.05, .075, .22, 1.0}},
};

}  // namespace

std::vector<BenchRow> BenchRows() {
  constexpr int64_t kResolutions[] = {128, 512, 1024, 2048};
  const auto dense = ResultKind::kDense, sparse = ResultKind::kSparse;
  Rows rows;
  for (const Times& times : kConservativeBits) {
    for (int i = 0; i < 4; ++i) {
      rows.Add(times.mesh, "bit conservative", kResolutions[i], times.pass_ms[i], times.stretch_ms[i],
               Bits(Coverage::kConservative));
    }
    const std::string mesh = times.mesh;
    if (mesh == "sphere10M") {
      rows.Add("sphere10M", "bit thin", 512, .30, .17, Bits(Coverage::kThin));
      rows.Add("sphere10M", "bit thin", 1024, .37, .25, Bits(Coverage::kThin));
      rows.Add("sphere10M", "f32 max dense", 512, .45, .30, Floats(1, Blend::kMax, dense));
      rows.Add("sphere10M", "f32 max dense", 1024, 1.5, 1.15, Floats(1, Blend::kMax, dense));
      rows.Add("sphere10M", "f32 add dense", 512, .9, .45, Floats(1, Blend::kAdd, dense));
      rows.Add("sphere10M", "f32 add dense", 1024, 3.0, 1.5, Floats(1, Blend::kAdd, dense));
      rows.Add("sphere10M", "f32 max sparse", 1024, .9, .5, Floats(1, Blend::kMax, sparse));
      rows.Add("sphere10M", "4 x f32 max dense", 512, .85, .65, Floats(4, Blend::kMax, dense));
      rows.Add("sphere10M", "4 x f32 add dense", 512, 1.9, .9, Floats(4, Blend::kAdd, dense));
      rows.Add("sphere10M", "A-buffer conservative", 512, 1.1, .7, ABuffer(Coverage::kConservative));
      rows.Add("sphere10M", "A-buffer conservative", 1024, 1.6, 1.0, ABuffer(Coverage::kConservative));
      rows.Add("sphere10M", "A-buffer thin", 512, .85, .55, ABuffer(Coverage::kThin));
      rows.Add("sphere10M", "A-buffer thin", 1024, 1.15, .75, ABuffer(Coverage::kThin));
    }
    if (mesh == "nasty") {
      rows.Add("nasty", "f32 max dense", 512, .50, .30, Floats(1, Blend::kMax, dense));
      rows.Add("nasty", "f32 max dense", 1024, 1.9, 1.3, Floats(1, Blend::kMax, dense));
      rows.Add("nasty", "f32 add dense", 512, 1.0, .5, Floats(1, Blend::kAdd, dense));
      rows.Add("nasty", "f32 add dense", 1024, 3.4, 1.9, Floats(1, Blend::kAdd, dense));
      rows.Add("nasty", "A-buffer thin", 1024, .9, .55, ABuffer(Coverage::kThin));
    }
  }
  return rows.Take();
}

std::vector<BenchRow> WholeCallRows() {
  Rows rows;
  for (const char* mesh : {"bunny", "sphere10M"}) {
    for (const int64_t n : {512, 1024}) rows.Add(mesh, "bit dense", n, 0, 0, Bits(Coverage::kConservative));
    for (const int64_t n : {512, 1024}) {
      rows.Add(mesh, "f32 max dense", n, 0, 0, Floats(1, Blend::kMax, ResultKind::kDense));
    }
    VoxelizeRequest bricks = Bits(Coverage::kConservative);
    bricks.result = ResultKind::kSparse;
    rows.Add(mesh, "bit sparse", 1024, 0, 0, bricks);
    rows.Add(mesh, "f32 max sparse", 1024, 0, 0, Floats(1, Blend::kMax, ResultKind::kSparse));
    VoxelizeRequest displaced = Bits(Coverage::kConservative);
    displaced.vertex_shader = {"displace_along_normal", {{"distance", {-0.01}}}};
    rows.Add(mesh, "bit dense, displaced", 512, 0, 0, displaced);
    displaced.result = ResultKind::kSparse;
    rows.Add(mesh, "bit sparse, displaced", 512, 0, 0, displaced);
  }
  return rows.Take();
}

std::vector<BenchRow> ShaderRows() {
  struct Case {
    const char *name, *shader;
    VoxelFormat format;
    int components;
    Blend blend;
  };
  constexpr auto f32 = VoxelFormat::kF32, u8 = VoxelFormat::kU8;
  constexpr Case kCases[] = {{"f32 max triangle_id", "triangle_id", f32, 1, Blend::kMax},
                             {"f32 replace triangle_id", "triangle_id", f32, 1, Blend::kReplace},
                             {"f32x3 replace normal", "normal", f32, 3, Blend::kReplace},
                             {"f32x3 first normal", "normal", f32, 3, Blend::kFirst},
                             {"u8x4 replace base_color", "base_color", u8, 4, Blend::kReplace},
                             {"f32x3 replace attribute", "attribute", f32, 3, Blend::kReplace},
                             {"f32x3 max normal", "normal", f32, 3, Blend::kMax},
                             {"f32x3 average normal", "normal", f32, 3, Blend::kAverage},
                             {"u8x4 average base_color", "base_color", u8, 4, Blend::kAverage},
                             {"f32x3 average attribute", "attribute", f32, 3, Blend::kAverage},
                             {"f32 add triangle_id", "triangle_id", f32, 1, Blend::kAdd},
                             {"f32x3 average geometric_normal", "geometric_normal", f32, 3, Blend::kAverage}};
  const auto target_of = [](const Case& row) {
    TargetSpec target;
    target.format = row.format;
    target.components = row.components;
    target.blend = row.blend;
    target.shader.name = row.shader;
    if (target.shader.name == "attribute") target.shader.text["name"] = "_HEAT";
    return target;
  };
  Rows rows;
  for (const char* mesh : {"shaded2M", "shaded2M masked", "shaded10M"}) {
    for (const int64_t n : {256, 512, 1024}) {
      VoxelizeRequest request = Bits(Coverage::kConservative);
      request.result = ResultKind::kSparse;
      if (std::string_view(mesh) != "shaded2M masked") rows.Add(mesh, "bit", n, 0, 0, request);
      for (const Case& row : kCases) {
        const bool color = std::string_view(row.shader) == "base_color";
        const bool yardstick = &row == kCases;
        if (std::string_view(mesh) == "shaded2M masked" && !color && !yardstick) continue;  // these discard nothing
        request.targets = {target_of(row)};
        rows.Add(mesh, row.name, n, 0, 0, request);
      }
      request.targets.clear();
      for (const int i : {1, 2, 4, 8}) request.targets.push_back(target_of(kCases[i]));
      rows.Add(mesh, "four targets", n, 0, 0, request);
      request = Bits(Coverage::kConservative);
      request.targets = {target_of(kCases[2])};
      rows.Add(mesh, "f32x3 replace normal, dense", n, 0, 0, request);
      request.targets = {target_of(kCases[7])};
      rows.Add(mesh, "f32x3 average normal, dense", n, 0, 0, request);
      request.targets[0].blend = Blend::kReplace;
      request.result = ResultKind::kBuckets;
      rows.Add(mesh, "buckets of f32x3 normal", n, 0, 0, request);
    }
  }
  return rows.Take();
}

std::vector<BenchRow> StageRows() {
  Rows rows;
  for (const char* mesh : {"sphere10M", "nasty"}) {
    rows.Add(mesh, "bit conservative", 1024, 0, 0, Bits(Coverage::kConservative));
    rows.Add(mesh, "f32 max dense", 1024, 0, 0, Floats(1, Blend::kMax, ResultKind::kDense));
    rows.Add(mesh, "f32 add dense", 1024, 0, 0, Floats(1, Blend::kAdd, ResultKind::kDense));
    rows.Add(mesh, "f32 max sparse", 1024, 0, 0, Floats(1, Blend::kMax, ResultKind::kSparse));
    rows.Add(mesh, "A-buffer thin", 1024, 0, 0, ABuffer(Coverage::kThin));
  }
  // 10 M triangles in a few voxels, in more, in many.
  for (const int64_t n : {8, 64, 512}) {
    rows.Add("sphere10M", "f32 replace dense", n, 0, 0, Floats(1, Blend::kReplace, ResultKind::kDense));
  }
  return rows.Take();
}

}  // namespace voxelpipe::gpu
