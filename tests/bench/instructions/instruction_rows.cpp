// Small cases whose instructions instruction_counts.py counts: the pipeline's on one thread, scalar and AVX2, and those
// of a mesh file's loading and of a texture's filter.
// usage: instruction_rows [ROW...]     all rows without any; prints each row's name and how much it made
//
// Under callgrind (--instr-atstart=no) a dump of that name holds the counts of the row alone. Each row runs once before
// that, so that pools of pages are warm.
// Exit: 0, 1 where a row failed, 2 where there is no such row, 3 where all passed but those that need an instruction
// set which this machine does not have.
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "bench/inputs/attributes.h"
#include "bench/inputs/mesh_files.h"
#include "bench/meshes.h"
#include "cpu/rows/row_kernels.h"
#include "load/decode/mips.h"
#include "load/load_mesh.h"
#include "mesh/views/material_views.h"
#include "pipeline/voxelize.h"
#include "shaders/texture/texture.h"

#ifdef VOXELPIPE_VALGRIND
#include <valgrind/callgrind.h>
#endif

namespace voxelpipe::bench {
namespace {

struct Row {
  std::string name;
  std::function<absl::StatusOr<uint64_t>()> run;  // out: what it made; 0 is a failure
  SimdChoice simd = SimdChoice::kAuto;            // what the machine has to have
};

// Large triangles, eight of them over each other: shading is most of the work.
TriangleMesh Layers() {
  TriangleMesh mesh = BumpySphere(300);
  const auto once = mesh.triangles;
  for (int i = 1; i < 8; ++i) mesh.triangles.insert(mesh.triangles.end(), once.begin(), once.end());
  mesh.parts.at(0).triangle_count = mesh.triangles.size();
  AddAttributes(mesh, {256, false});
  return mesh;
}

// The meshes of all rows.
struct Meshes {
  Meshes() {
    AddAttributes(textured, {256, false});
    AddAttributes(masked, {256, true});
    TriangleMesh loaded = BumpyTorus(40'000);
    AddAttributes(loaded, {64, false});
    file = GlbBytes(loaded);
  }
  TriangleMesh fine = BumpySphere(20'000), coarse = BumpySphere(300), torus = BumpyTorus(3'000);
  TriangleMesh textured = BumpySphere(5'000), masked = textured, layers = Layers();
  std::vector<uint8_t> file;
};

absl::StatusOr<uint64_t> Occupied(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  const absl::StatusOr<VoxelizeResult> result = Voxelize(mesh, request, {PlainJob()});
  if (!result.ok()) return result.status();
  return result->stats.occupied;
}

// Adds rows of one instruction set.
class Rows {
 public:
  Rows(const Meshes& meshes, SimdChoice simd, std::vector<Row>& rows) : meshes_(meshes), simd_(simd), rows_(rows) {}

  // Bits unless `change` says otherwise.
  template <typename Change>
  void Add(const char* name, const TriangleMesh& mesh, int64_t resolution, const Change& change) {
    VoxelizeRequest request;
    request.grid.resolution = resolution;
    request.grid.fit = GridFit::kCube;
    request.backend = BackendChoice::kCpu;
    request.threads = 1;
    request.simd = simd_;
    change(request);
    rows_.push_back(
        {std::string(Name(simd_)) + "/" + name, [&mesh, request] { return Occupied(mesh, request); }, simd_});
  }

  void AddTarget(const char* name, const TriangleMesh& mesh, ResultKind kind, VoxelFormat format, int components,
                 Blend blend, const char* shader) {
    Add(name, mesh, 96, [&](VoxelizeRequest& request) {
      TargetSpec target;
      target.format = format;
      target.components = components;
      target.blend = blend;
      target.shader = {shader, {}, {}};
      request.targets = {target};
      request.result = kind;
    });
  }

  void AddAll() {
    using enum VoxelFormat;
    using enum ResultKind;
    Add("bits conservative", meshes_.fine, 128, [](VoxelizeRequest&) {});
    Add("bits thin", meshes_.fine, 128, [](VoxelizeRequest& r) { r.coverage = Coverage::kThin; });
    Add("bits of large triangles", meshes_.coarse, 192, [](VoxelizeRequest&) {});
    Add("parity fill", meshes_.torus, 128, [](VoxelizeRequest& r) { r.fill = Fill::kParity; });
    Add("flood fill", meshes_.torus, 96, [](VoxelizeRequest& r) { r.fill = Fill::kFlood; });
    AddTarget("f32 max triangle_id dense", meshes_.fine, kDense, kF32, 1, Blend::kMax, "triangle_id");
    AddTarget("f32 max triangle_id sparse", meshes_.fine, kSparse, kF32, 1, Blend::kMax, "triangle_id");
    AddTarget("f32x3 replace normal sparse", meshes_.textured, kSparse, kF32, 3, Blend::kReplace, "normal");
    AddTarget("f32x3 average normal sparse", meshes_.textured, kSparse, kF32, 3, Blend::kAverage, "normal");
    AddTarget("f32x3 first normal sparse", meshes_.textured, kSparse, kF32, 3, Blend::kFirst, "normal");
    AddTarget("u8x4 replace base_color sparse", meshes_.textured, kSparse, kU8, 4, Blend::kReplace, "base_color");
    AddTarget("u8x4 average base_color sparse", meshes_.textured, kSparse, kU8, 4, Blend::kAverage, "base_color");
    AddTarget("u8x4 replace masked sparse", meshes_.masked, kSparse, kU8, 4, Blend::kReplace, "base_color");
    AddTarget("u8x4 average base_color of layers", meshes_.layers, kSparse, kU8, 4, Blend::kAverage, "base_color");
    AddTarget("buckets of bits", meshes_.fine, kBuckets, kBit, 1, Blend::kOr, "occupancy");
    AddTarget("buckets of u8x4 base_color", meshes_.textured, kBuckets, kU8, 4, Blend::kReplace, "base_color");
  }

 private:
  const Meshes& meshes_;
  const SimdChoice simd_;
  std::vector<Row>& rows_;
};

absl::StatusOr<uint64_t> LoadAndFlatten(const std::vector<uint8_t>& file) {
  const absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(PlainJob(), file, {});
  if (!loaded.ok()) return loaded.status();
  return loaded->mesh.triangles.size();
}

absl::StatusOr<uint64_t> MakeMips(const Image& image) {
  const absl::StatusOr<std::vector<Vec4f>> mips =
      BuildMips(PlainJob(), image.rgba.data(), image.width, image.height, true);
  if (!mips.ok()) return mips.status();
  return mips->size();
}

// Samples between the first levels, which a user's texture is mostly read at.
absl::StatusOr<uint64_t> Sample(const TriangleMesh& mesh) {
  const TextureView texture = MakeMaterialViews(mesh).textures.at(1);  // as sRGB colours
  uint64_t light = 0;
  for (int i = 0; i < 50'000; ++i) {
    const Vec2f uv{float(i % 251) / 250, float(i % 1009) / 1008};
    light += SampleTexture(texture, uv, 1 + float(i % 8) / 4).w > 0.5f;
  }
  return light;
}

// In an arena of one thread: in others the pieces of a parallel loop, and so its count, follow the number of cores.
template <typename Work>
absl::StatusOr<uint64_t> OnOneThread(const Work& work) {
  tbb::task_arena arena(1);
  return arena.execute(work);
}

std::vector<Row> AllRows(const Meshes& meshes) {
  std::vector<Row> rows;
  for (const SimdChoice simd : {SimdChoice::kScalar, SimdChoice::kAvx2}) Rows(meshes, simd, rows).AddAll();
  rows.push_back(
      {"load and flatten a GLB", [&meshes] { return OnOneThread([&meshes] { return LoadAndFlatten(meshes.file); }); }});
  rows.push_back({"levels of a texture",
                  [&meshes] { return OnOneThread([&meshes] { return MakeMips(*meshes.textured.images[0]); }); }});
  rows.push_back({"filter of a texture", [&meshes] { return Sample(meshes.textured); }});
  return rows;
}

int Fail(const Row& row, const absl::Status& why) {
  std::fprintf(stderr, "%s: %s\n", row.name.c_str(), why.ToString().c_str());
  return 1;
}

int Run(const Row& row) {
  if (const absl::StatusOr<uint64_t> warm = row.run(); !warm.ok()) return Fail(row, warm.status());
#ifdef VOXELPIPE_VALGRIND
  CALLGRIND_ZERO_STATS;
  CALLGRIND_START_INSTRUMENTATION;
#endif
  const absl::StatusOr<uint64_t> counted = row.run();
#ifdef VOXELPIPE_VALGRIND
  CALLGRIND_STOP_INSTRUMENTATION;
  CALLGRIND_DUMP_STATS_AT(row.name.c_str());
#endif
  if (!counted.ok()) return Fail(row, counted.status());
  std::printf("%s: %llu\n", row.name.c_str(), static_cast<unsigned long long>(*counted));
  return *counted > 0 ? 0 : 1;
}

int Main(const std::vector<std::string>& wanted) {
  const Meshes meshes;
  const std::vector<Row> rows = AllRows(meshes);
  for (const std::string& name : wanted) {
    if (std::any_of(rows.begin(), rows.end(), [&name](const Row& row) { return row.name == name; })) continue;
    std::fprintf(stderr, "instruction_rows: no row %s\n", name.c_str());
    return 2;
  }
  bool failed = false, left_out = false;
  for (const Row& row : rows) {
    if (!wanted.empty() && std::find(wanted.begin(), wanted.end(), row.name) == wanted.end()) continue;
    if (const auto kernels = cpu::SelectRowKernels(row.simd); !kernels.ok()) {
      std::fprintf(stderr, "%s: left out: %s\n", row.name.c_str(), kernels.status().ToString().c_str());
      left_out = true;
    } else if (Run(row) != 0) {
      failed = true;
    }
  }
  return failed ? 1 : left_out ? 3 : 0;
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  return voxelpipe::bench::Main({argv + 1, argv + argc});
}
