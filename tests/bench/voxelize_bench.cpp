// The pipeline's speed, on generated meshes and any given ones, beside the plain loop and the machine's own limits.
// usage: voxelize_bench [--mesh=NAME=FILE]... [--threads=N] [Google Benchmark's options]
//
// Rows are MESH/CASE/RESOLUTION. The grid is a cube of RESOLUTION voxels. Counters, in milliseconds but for counts:
// wall, cpu and their spread are the pipeline's own (mesh in memory to result in memory, clearing included), warm:
// medians, and the least. `floor` is what the machine itself needs: the result's bytes at the measured rate of clearing
// (for bricks those of the mesh too, which is read once), or fragments at the measured rate of sorting 64-bit keys.
// `stage.NAME` are the pipeline's stages, wall, medians.
#include <benchmark/benchmark.h>
#include <tbb/parallel_sort.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <random>

#include "bench/inputs/attributes.h"
#include "bench/meshes.h"
#include "bench/peers/openvdb_peer.h"
#include "bench/peers/yardstick.h"
#include "load/loader.h"
#include "load/pack.h"
#include "mesh/flatten.h"
#include "pipeline/voxelize.h"

namespace voxelpipe::bench {
namespace {

int g_threads = 0;

double ThreadCpuMs() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

double Quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[size_t(q * double(values.size() - 1) + 0.5)];
}

// What a mesh has and a case's shaders read.
enum class Attributes : uint8_t { kNone, kTextured, kMasked };

struct Case {
  std::string name;
  VoxelizeRequest request;
  std::vector<int64_t> resolutions;
  Attributes reads = Attributes::kNone;
};

TargetSpec Target(VoxelFormat format, int components, Blend blend, const char* shader) {
  TargetSpec target;
  target.format = format;
  target.components = components;
  target.blend = blend;
  target.shader = {shader, {}, {}};
  return target;
}

// Cases of targets, sparse unless their name says otherwise.
void AddShadedCases(std::vector<Case>& cases) {
  const std::vector<int64_t> all{64, 512, 1024}, some{64, 512};
  const auto add = [&](const char* name, const std::vector<int64_t>& resolutions, ResultKind kind,
                       const std::vector<TargetSpec>& targets, Attributes reads = Attributes::kTextured) {
    Case c{name, {}, resolutions, reads};
    c.request.grid.fit = GridFit::kCube;
    c.request.threads = g_threads;
    c.request.targets = targets;
    c.request.result = kind;
    cases.push_back(c);
  };
  const auto normal = [](Blend blend) { return Target(VoxelFormat::kF32, 3, blend, "normal"); };
  const auto color = [](Blend blend) { return Target(VoxelFormat::kU8, 4, blend, "base_color"); };
  const TargetSpec bits, id = Target(VoxelFormat::kF32, 1, Blend::kMax, "triangle_id");
  using enum ResultKind;
  add("bits_dense", all, kDense, {bits});
  add("f32_max", all, kSparse, {id});
  add("f32_max_dense", some, kDense, {id});
  add("normal_replace", all, kSparse, {normal(Blend::kReplace)});
  add("normal_first", some, kSparse, {normal(Blend::kFirst)});
  add("normal_average", some, kSparse, {normal(Blend::kAverage)});
  add("normal_replace_dense", some, kDense, {normal(Blend::kReplace)});
  add("normal_average_dense", some, kDense, {normal(Blend::kAverage)});
  add("color_replace", all, kSparse, {color(Blend::kReplace)});
  add("color_average", some, kSparse, {color(Blend::kAverage)});
  add("color_buckets", some, kBuckets, {color(Blend::kReplace)});
  add("six_targets", some, kSparse,
      {id, normal(Blend::kReplace), normal(Blend::kAverage), color(Blend::kReplace), color(Blend::kAverage),
       Target(VoxelFormat::kF32, 2, Blend::kReplace, "uv")});
  add("masked_replace", some, kSparse, {color(Blend::kReplace)}, Attributes::kMasked);
  add("masked_buckets", some, kBuckets, {color(Blend::kReplace)}, Attributes::kMasked);
}

std::vector<Case> Cases() {
  const std::vector<int64_t> all{128, 256, 512, 1024}, some{512};
  std::vector<Case> cases;
  const auto add = [&](const char* name, const std::vector<int64_t>& resolutions, const auto& change) {
    Case c{name, {}, resolutions};
    c.request.grid.fit = GridFit::kCube;
    c.request.threads = g_threads;
    change(c.request);
    cases.push_back(c);
  };
  add("conservative", all, [](VoxelizeRequest&) {});
  add("thin", all, [](VoxelizeRequest& r) { r.coverage = Coverage::kThin; });
  add("solid", some, [](VoxelizeRequest& r) { r.fill = Fill::kParity; });
  add("flood", some, [](VoxelizeRequest& r) { r.fill = Fill::kFlood; });
  add("f32_max_dense", some,
      [](VoxelizeRequest& r) { r.targets = {Target(VoxelFormat::kF32, 1, Blend::kMax, "triangle_id")}; });
  add("f32x4_add_dense", some,
      [](VoxelizeRequest& r) { r.targets = {Target(VoxelFormat::kF32, 4, Blend::kAdd, "normal")}; });
  add("f32_max_sparse", some, [](VoxelizeRequest& r) {
    r.targets = {Target(VoxelFormat::kF32, 1, Blend::kMax, "triangle_id")};
    r.result = ResultKind::kSparse;
  });
  add("a_buffer_conservative", some, [](VoxelizeRequest& r) { r.result = ResultKind::kBuckets; });
  add("a_buffer_thin", some, [](VoxelizeRequest& r) {
    r.result = ResultKind::kBuckets;
    r.coverage = Coverage::kThin;
  });
  AddShadedCases(cases);
  return cases;
}

// Bytes a millisecond of clearing memory that was used before, by the pipeline's own clear.
double ClearRate() {
  static const double rate = [] {
    TriangleMesh nothing;
    VoxelizeRequest request;
    request.threads = g_threads;
    request.grid.dims = {512, 512, 256};
    request.grid.origin = Vec3d{0, 0, 0};
    request.grid.voxel_size = Vec3d{1, 1, 1};
    request.targets = {Target(VoxelFormat::kF32, 1, Blend::kMax, "occupancy")};
    std::vector<double> ms;
    for (int i = 0; i < 7; ++i) ms.push_back(Voxelize(nothing, request, {JobContext()})->stats.voxelize_ms);
    return 512.0 * 512 * 256 * 4 / Quantile(ms, 0.5);
  }();
  return rate;
}

// 64-bit keys a millisecond that oneTBB sorts.
double SortRate() {
  static const double rate = [] {
    std::vector<uint64_t> keys(4 << 20);
    std::vector<double> ms;
    tbb::task_arena arena(g_threads > 0 ? g_threads : tbb::task_arena::automatic);
    for (int i = 0; i < 5; ++i) {
      std::mt19937_64 random(5);
      for (uint64_t& key : keys) key = random();
      const auto begin = std::chrono::steady_clock::now();
      arena.execute([&] { tbb::parallel_sort(keys.begin(), keys.end()); });
      ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
    }
    return double(keys.size()) / Quantile(ms, 0.5);
  }();
  return rate;
}

void Measure(benchmark::State& state, const TriangleMesh& mesh, VoxelizeRequest request) {
  request.grid.resolution = state.range(0);
  std::vector<double> wall, cpu;
  std::map<std::string, std::vector<double>> stages;
  VoxelizeResult result;
  for (auto _ : state) {
    result = VoxelizeResult();
    absl::StatusOr<VoxelizeResult> made = Voxelize(mesh, request, {JobContext()});
    if (!made.ok()) return state.SkipWithError(made.status().ToString().c_str());
    result = *std::move(made);
    state.SetIterationTime(result.stats.voxelize_ms / 1e3);
    wall.push_back(result.stats.voxelize_ms);
    cpu.push_back(result.stats.voxelize_cpu_ms);
    if (wall.size() == 1) continue;  // the first one warms the pool of pages
    for (const auto& [name, ms] : result.stats.stages) stages[name].push_back(ms);
  }
  wall.erase(wall.begin());
  cpu.erase(cpu.begin());
  for (const auto& [name, ms] : stages) state.counters["stage." + name] = Quantile(ms, 0.5);
  state.counters["wall"] = Quantile(wall, 0.5);
  state.counters["wall_p10"] = Quantile(wall, 0.1);
  state.counters["wall_p90"] = Quantile(wall, 0.9);
  state.counters["cpu"] = Quantile(cpu, 0.5);
  state.counters["cpu_min"] = Quantile(cpu, 0);
  state.counters["occupied"] = double(result.stats.occupied);
  if (request.result == ResultKind::kBuckets) {
    state.counters["floor"] = double(*result.stats.fragments) / SortRate();
  } else if (request.result == ResultKind::kDense && request.targets[0].format == VoxelFormat::kF32) {
    state.counters["floor"] = double(result.targets[0].size()) / ClearRate();
  } else if (request.result == ResultKind::kSparse) {
    const uint64_t written = result.bricks.size() + result.masks.size() + result.targets[0].size();
    const uint64_t read =
        mesh.positions.size() * sizeof(mesh.positions[0]) + mesh.triangles.size() * sizeof(mesh.triangles[0]);
    state.counters["floor"] = double(written + read) / ClearRate();
  }
}

void MeasureYardstick(benchmark::State& state, const TriangleMesh& mesh) {
  VoxelizeRequest request;
  request.grid.resolution = state.range(0);
  request.grid.fit = GridFit::kCube;
  request.threads = 1;
  const VoxelizeResult ours = *Voxelize(mesh, request, {JobContext()});
  std::vector<double> cpu, own, own_wall, peer_cpu, peer_wall;
  std::vector<uint8_t> plain;
  uint64_t peer_voxels = 0;
  for (auto _ : state) {  // one beside the other: the machine is noisy
    const double begin = ThreadCpuMs();
    plain = PlainLoop(mesh, ours.grid);
    cpu.push_back(ThreadCpuMs() - begin);
    const VoxelizeStats stats = Voxelize(mesh, request, {JobContext()})->stats;
    own.push_back(stats.voxelize_cpu_ms);
    own_wall.push_back(stats.voxelize_ms);
    if (const std::optional<PeerRun> peer = RunOpenVdb(mesh, ours.grid, 1)) {
      peer_cpu.push_back(peer->cpu_ms);
      peer_wall.push_back(peer->wall_ms);
      peer_voxels = peer->voxels;
    }
    state.SetIterationTime(cpu.back() / 1e3);
  }
  double missed = 0;
  for (size_t i = 0; i < plain.size(); ++i) missed += std::popcount(uint8_t(plain[i] & ~ours.targets[0].data()[i]));
  state.counters["cpu"] = Quantile(cpu, 0.5);
  state.counters["ours_cpu"] = Quantile(own, 0.5);
  state.counters["ours_wall"] = Quantile(own_wall, 0.5);
  state.counters["ours_voxels"] = double(ours.stats.occupied);
  state.counters["ratio"] = Quantile(cpu, 0.5) / Quantile(own, 0.5);
  state.counters["missed"] = missed;
  if (peer_cpu.empty()) return;  // built without OpenVDB
  state.counters["openvdb_cpu"] = Quantile(peer_cpu, 0.5);
  state.counters["openvdb_wall"] = Quantile(peer_wall, 0.5);
  state.counters["openvdb_voxels"] = double(peer_voxels);
}

TriangleMesh LoadFile(const std::string& path) {
  const absl::StatusOr<PackedMesh> file = ReadAndPackMeshFile(path);
  absl::StatusOr<Scene> scene = file.ok() ? LoadScene(file->bytes, file->format) : file.status();
  absl::StatusOr<TriangleMesh> mesh = scene.ok() ? Flatten(*scene) : scene.status();
  if (!mesh.ok()) {
    std::fprintf(stderr, "%s: %s\n", path.c_str(), mesh.status().ToString().c_str());
    std::exit(1);
  }
  return *std::move(mesh);
}

int Main(int argc, char** argv) {
  std::vector<std::pair<std::string, std::string>> files;
  int kept = 1;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument.rfind("--mesh=", 0) == 0 && argument.find('=', 7) != std::string::npos) {
      const size_t equals = argument.find('=', 7);
      files.emplace_back(argument.substr(7, equals - 7), argument.substr(equals + 1));
    } else if (argument.rfind("--threads=", 0) == 0) {
      g_threads = std::atoi(argument.c_str() + 10);
    } else {
      argv[kept++] = argv[i];
    }
  }
  argc = kept;
  // Made when the first of its rows runs: a filter may leave most of them out.
  using Maker = std::function<TriangleMesh()>;
  struct Input {
    std::string name;
    Maker make;
    Attributes has = Attributes::kNone;
  };
  std::vector<Input> inputs;
  for (const auto& [name, path] : files) inputs.push_back({name, [path = path] { return LoadFile(path); }});
  inputs.push_back({"sphere70k", [] { return BumpySphere(70'000); }});
  inputs.push_back({"mix", [] { return Mixed(); }});
  inputs.push_back({"sphere1M", [] { return Subdivided(BumpySphere(70'000), 2); }});
  inputs.push_back({"torus5M", [] { return BumpyTorus(5'200'000); }});
  for (const auto& [name, path] : files) {
    if (name == "bunny") inputs.push_back({"bunny1M", [path = path] { return Subdivided(LoadFile(path), 2); }});
  }
  const auto shaded = [](bool masked) {
    TriangleMesh mesh = BumpySphere(1'000'000);
    AddAttributes(mesh, {1024, masked});
    return mesh;
  };
  inputs.push_back({"shaded1M", [=] { return shaded(false); }, Attributes::kTextured});
  inputs.push_back({"masked1M", [=] { return shaded(true); }, Attributes::kMasked});
  static std::map<std::string, TriangleMesh> meshes;
  const auto mesh_of = [](const std::string& name, const Maker& make) -> const TriangleMesh& {
    const auto known = meshes.find(name);
    if (known != meshes.end()) return known->second;
    meshes.clear();  // one at a time
    return meshes.emplace(name, make()).first->second;
  };
  // A flood whose way is long.
  auto* maze = benchmark::RegisterBenchmark("maze/flood", [=](benchmark::State& state) {
    VoxelizeRequest request;
    request.grid.fit = GridFit::kCube;
    request.threads = g_threads;
    request.fill = Fill::kFlood;
    Measure(state, mesh_of("maze", [] { return Maze(27); }), request);
  });
  for (const int64_t resolution : {128, 256, 400, 512}) maze->Arg(resolution);
  maze->UseManualTime()->Iterations(6)->Unit(benchmark::kMillisecond);
  for (const Input& input : inputs) {
    for (const Case& c : Cases()) {
      if (c.reads != input.has) continue;
      auto* row = benchmark::RegisterBenchmark((input.name + "/" + c.name).c_str(), [=](benchmark::State& state) {
        Measure(state, mesh_of(input.name, input.make), c.request);
      });
      for (const int64_t resolution : c.resolutions) row->Arg(resolution);
      row->UseManualTime()->Iterations(12)->Unit(benchmark::kMillisecond);
    }
    if (input.has != Attributes::kNone) continue;
    benchmark::RegisterBenchmark(
        (input.name + "/yardstick").c_str(),
        [=](benchmark::State& state) { MeasureYardstick(state, mesh_of(input.name, input.make)); })
        ->Arg(512)
        ->UseManualTime()
        ->Iterations(3)
        ->Unit(benchmark::kMillisecond);
  }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  return voxelpipe::bench::Main(argc, argv);
}
