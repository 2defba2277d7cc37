// Whole calls, step by step: from a mesh file's bytes in memory to the result in memory.
//
// usage: whole_calls [OPTION]...
//   --backend NAME   cpu (default) or cuda        --threads N   of the CPU backend (0: all)
//   --filter TEXT    only rows whose line "CASE, KIND MESH N" holds TEXT
//   --repeats N      measured calls a row (7)     --large       meshes of 10 million triangles too
//   --rate GB        GB/s at which the device gets and gives bytes, for the floor of cuda (55: pinned, over PCIe)
//
// Prints a Markdown table for import_results.py. `load` parses and decodes, images too; `flatten` makes the mesh; then
// come the stages that the engine reports. "new": the file is loaded in each call; "kept": the mesh is there, and has
// the id by which the engine knows it again. The floor is the bytes that have to move, at the machine's rates: the file
// read, the mesh written and read, the result written; of cuda, mesh (unless kept) and result over the bus. `assimp`:
// the time of its loader for the same bytes, where the benchmarks were built with it. The grid is a cube.
// Exit: 0, 1 where a call failed, 77 where there is no such backend.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/wall_clock.h"
#include "bench/inputs/attributes.h"
#include "bench/inputs/compressed_files.h"
#include "bench/inputs/mesh_files.h"
#include "bench/inputs/one_target.h"
#include "bench/meshes.h"
#include "bench/peers/assimp_peer.h"
#include "load/load_mesh.h"
#include "mesh/mesh_bytes.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "shaders/catalog.h"

namespace voxelpipe::bench {
namespace {

struct Options {
  BackendChoice backend = BackendChoice::kCpu;
  int threads = 0, repeats = 7;
  bool large = false;
  std::string filter;
  double bus_gb_s = 55;
};

// A kind of file.
struct Kind {
  const char* name;
  const char* extension;
  bool textured;
  std::vector<uint8_t> (*bytes)(const TriangleMesh& mesh);
};
constexpr Kind kGlb{"GLB", "glb", false, GlbBytes}, kTextured{"textured GLB", "glb", true, GlbBytes},
    kQuantized{"quantized, meshopt", "glb", false, QuantizedGlbBytes}, kDraco{"Draco", "drc", false, DracoBytes},
    kStl{"STL", "stl", false, StlBytes};

struct Row {
  std::string name;  // of the request
  const Kind* kind;
  int64_t triangles, n;
  bool kept;
  VoxelizeRequest request;
};

VoxelizeRequest Make(ResultKind result, VoxelFormat format, int components, Blend blend, const char* shader) {
  VoxelizeRequest request = OneTarget(format, components, blend, shader, result);
  request.grid.fit = GridFit::kCube;
  return request;
}

std::vector<Row> Rows(const Options& options) {
  using enum ResultKind;
  using enum VoxelFormat;
  const VoxelizeRequest bits = Make(kDense, kBit, 1, Blend::kOr, "occupancy");
  const VoxelizeRequest ids = Make(kSparse, kF32, 1, Blend::kMax, "triangle_id");
  const VoxelizeRequest normals = Make(kSparse, kF32, 3, Blend::kReplace, "normal");
  const VoxelizeRequest colors = Make(kSparse, kU8, 4, Blend::kReplace, "base_color");
  const VoxelizeRequest dense = Make(kDense, kF32, 1, Blend::kMax, "triangle_id");
  std::vector<Row> rows;
  const auto add = [&](const char* name, const Kind& kind, int64_t triangles, int64_t n, bool kept,
                       const VoxelizeRequest& request) {
    rows.push_back({absl::StrCat(name, kept ? ", kept" : ", new"), &kind, triangles, n, kept, request});
    VoxelizeRequest& made = rows.back().request;
    made.grid.resolution = n;
    made.backend = options.backend;
    made.threads = options.threads;
  };
  std::vector<int64_t> sizes{1'000, 30'000, 2'000'000};
  if (options.large) sizes.push_back(10'000'000);
  for (const int64_t triangles : sizes) {
    for (const Kind* kind : {&kGlb, &kQuantized, &kDraco, &kStl}) {
      add("bits", *kind, triangles, 64, false, bits);
      add("sparse f32x3 replace normal", *kind, triangles, 512, false, normals);
    }
    for (const bool kept : {false, true}) {
      add("sparse u8x4 replace base_color", kTextured, triangles, 512, kept, colors);
      add("sparse f32x3 replace normal", kGlb, triangles, 512, kept, normals);
    }
  }
  // Below, at and above the sizes at which a call is cut in slabs or takes another way.
  for (const bool kept : {false, true}) {
    for (const int64_t n : {960, 992, 1024, 1040}) {
      add("sparse f32 max", kGlb, 2'000'000, n, kept, ids);
      add("sparse f32x3 replace normal", kGlb, 2'000'000, n, kept, normals);
      add("dense f32 max", kGlb, 30'000, n, kept, dense);
    }
  }
  // The loops above name a few rows twice.
  const auto line = [](const Row& row) { return absl::StrCat(row.name, row.kind->name, row.triangles, "/", row.n); };
  std::map<std::string, int> seen;
  std::erase_if(rows, [&](const Row& row) { return seen[line(row)]++ > 0; });
  return rows;
}

double Median(std::vector<double> values, double q = 0.5) {
  std::sort(values.begin(), values.end());
  return values[size_t(q * double(values.size() - 1) + 0.5)];
}

// GB/s at which this process reads and writes memory that it has touched, on one thread.
double MemoryRate() {
  static const double rate = [] {
    std::vector<uint8_t> from(256 << 20, 1), to(from.size());
    std::vector<double> ms;
    for (int i = 0; i < 5; ++i) {
      const double begin = WallMs();
      std::memcpy(to.data(), from.data(), from.size());
      ms.push_back(WallMs() - begin);
      from[0] = to[size_t(i)];
    }
    return 2 * double(from.size()) / Median(ms) * 1e-6;
  }();
  return rate;
}

// What the calls of a row took.
struct Times {
  std::vector<double> whole;
  std::vector<std::pair<std::string, std::vector<double>>> steps;  // in the order of the first call

  void Add(const std::string& name, double ms) {
    auto step = std::find_if(steps.begin(), steps.end(), [&](const auto& known) { return known.first == name; });
    if (step == steps.end()) step = steps.insert(steps.end(), {name, {}});
    step->second.push_back(ms);
  }
};

class Bench {
 public:
  explicit Bench(const Options& options) : options_(options) {}

  int Run() {
    std::printf("| call from bytes, %s | mesh | N | ms | p10-p90 | floor | steps | assimp | file MB | result MB |\n",
                options_.backend == BackendChoice::kCuda ? "cuda" : "cpu");
    std::printf("|---|---|---|---|---|---|---|---|---|---|\n");
    for (const Row& row : Rows(options_)) {
      const std::string name = absl::StrCat(row.name, ", ", row.kind->name);
      const std::string mesh = row.triangles >= 1'000'000 ? absl::StrCat("sphere", row.triangles / 1'000'000, "M")
                                                          : absl::StrCat("sphere", row.triangles / 1'000, "k");
      if (!absl::StrContains(absl::StrCat(name, " ", mesh, " ", row.n), options_.filter)) continue;
      const absl::StatusOr<std::string> figures = Measure(row);
      std::printf("| %s | %s | %lld | %s |\n", name.c_str(), mesh.c_str(), static_cast<long long>(row.n),
                  figures.ok() ? figures->c_str() : figures.status().ToString().c_str());
      std::fflush(stdout);
      if (!figures.ok()) code_ = absl::IsFailedPrecondition(figures.status()) ? 77 : 1;
    }
    return code_;
  }

 private:
  const std::vector<uint8_t>& FileOf(const Row& row) {
    if (file_kind_ == row.kind && file_triangles_ == row.triangles) return file_;
    TriangleMesh mesh = BumpySphere(row.triangles);
    AddAttributes(mesh, {1024, false});
    if (!row.kind->textured) {
      mesh.images.clear();
      mesh.uv[0].clear();
    }
    file_ = row.kind->bytes(mesh);
    file_kind_ = row.kind;
    file_triangles_ = row.triangles;
    return file_;
  }

  absl::StatusOr<std::string> Measure(const Row& row) {
    const std::vector<uint8_t>& file = FileOf(row);
    LoadRequest load;
    load.type = *MeshFormatOfName(absl::StrCat("mesh.", row.kind->extension));
    load.textures = TexturesRead(row.request);
    absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(PlainJob(), file, load);
    if (!loaded.ok()) return loaded.status();
    if (row.kept) loaded->mesh.content_id = absl::StrCat("whole_calls ", row.kind->name, row.triangles);
    Times times;
    uint64_t result_bytes = 0;
    for (int i = 0; i <= options_.repeats; ++i) {
      const double begin = WallMs();
      if (!row.kept) {
        loaded = LoadMeshFor(PlainJob(), file, load);
        if (!loaded.ok()) return loaded.status();
      }
      const absl::StatusOr<VoxelizeResult> result = Voxelize(loaded->mesh, row.request, {PlainJob()});
      const double whole = WallMs() - begin;
      if (!result.ok()) return result.status();
      result_bytes = result->bytes();
      if (i == 0) continue;  // it warms pools and caches
      times.whole.push_back(whole);
      if (!row.kept) {
        times.Add("load", loaded->load_ms);
        times.Add("flatten", loaded->flatten_ms);
      }
      for (const auto& [name, ms] : result->stats.stages) times.Add(name, ms);
    }
    return Figures(row, times, file.size(), MeshBytes(loaded->mesh), result_bytes);
  }

  std::string Figures(const Row& row, const Times& times, uint64_t file, uint64_t mesh, uint64_t result) {
    const double mb = 1e-6, memory = MemoryRate();
    double floor = row.kept ? 0 : (double(file) + double(mesh)) * mb / memory;
    if (options_.backend == BackendChoice::kCuda) {
      floor += (double(result) + (row.kept ? 0 : double(mesh))) * mb / options_.bus_gb_s;
    } else {
      floor += (double(mesh) + double(result)) * mb / memory;
    }
    std::string steps;
    for (const auto& [name, ms] : times.steps)
      absl::StrAppend(&steps, steps.empty() ? "" : ", ", name, absl::StrFormat(" %.3g", Median(ms)));
    std::optional<PeerLoad> assimp;
    if (!row.kept) assimp = LoadWithAssimp(file_, row.kind->extension);
    return absl::StrFormat("%.4g | %.4g-%.4g | %.3g | %s | %s | %.4g | %.4g", Median(times.whole),
                           Median(times.whole, 0.1), Median(times.whole, 0.9), floor, steps,
                           assimp ? absl::StrFormat("%.4g", assimp->wall_ms) : "", double(file) * mb,
                           double(result) * mb);
  }

  const Options options_;
  int code_ = 0;
  std::vector<uint8_t> file_;  // the last one that was made
  const Kind* file_kind_ = nullptr;
  int64_t file_triangles_ = 0;
};

int Main(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--large") {
      options.large = true;
      continue;
    }
    const char* const value = i + 1 < argc ? argv[++i] : "";
    if (name == "--backend") {
      options.backend = std::strcmp(value, "cuda") == 0 ? BackendChoice::kCuda : BackendChoice::kCpu;
    } else if (name == "--threads") {
      options.threads = std::atoi(value);
    } else if (name == "--repeats") {
      options.repeats = std::max(1, std::atoi(value));
    } else if (name == "--filter") {
      options.filter = value;
    } else if (name == "--rate") {
      options.bus_gb_s = std::atof(value);
    } else {
      std::fprintf(stderr, "whole_calls: %s is no option; the source says which there are\n", name.c_str());
      return 2;
    }
  }
  return Bench(options).Run();
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  return voxelpipe::bench::Main(argc, argv);
}
