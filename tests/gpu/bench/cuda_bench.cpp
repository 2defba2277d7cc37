// The GPU table: times of the CUDA backend beside what is asked for, the times of its stages, and whole calls beside
// what the bus needs.
//
// usage: cuda_bench [OPTION]...
//   --bunny FILE    a bunny of 69,451 triangles     --cow FILE   a mesh of about 5,800 in place of its decimation
//   --filter TEXT   only rows whose line "MESH CASE N" holds TEXT; of several, with | between them, one
//   --budget S      rows that would begin after so many seconds are not run, and say so
//   --repeats N     at most so many measured runs a row (60)      --warmup N   runs before them (3)
//   --only PART     one of: table, shaders, stages, calls, batch
//   --memory BYTES  limit of the device's memory: larger grids use slabs
//
// Method of the table: mesh on the device, result left there, CUDA events on the backend's stream around the whole
// call, clearing included, median of the measured runs and their 10th and 90th percentiles. Whole calls: wall clock of
// Voxelize().
// A row whose voxels are not as many as the CPU's has failed, however fast it was.
// Exit: 0 every row was measured, 1 some failed or were not run, 77 no CUDA device. Missed targets do not change it.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "cuda/backend.h"
#include "cuda/device/device.h"
#include "cuda/plan/path_plan.h"
#include "gpu/bench/bench_call.h"
#include "gpu/bench/bench_rows.h"
#include "gpu/cases/bench_meshes.h"
#include "mesh/content_id.h"
#include "pipeline/batch.h"
#include "pipeline/stages/backend.h"
#include "pipeline/stages/bind.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

using Clock = std::chrono::steady_clock;

double MsSince(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

double Quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[size_t(q * double(values.size() - 1) + 0.5)];
}

// 3 digits that matter.
std::string Ms(double ms) {
  return ms < 0.1 ? absl::StrFormat("%.4f", ms) : ms < 10 ? absl::StrFormat("%.3f", ms) : absl::StrFormat("%.1f", ms);
}

struct Options {
  std::string bunny, cow, filter, only;
  double budget_s = 1e9;
  int repeats = 60, warmup = 3;
};

class Bench {
 public:
  Bench(const Options& options, const Backend& backend)
      : options_(options), backend_(backend), meshes_(BenchMeshes(options.bunny, options.cow)) {}

  int Run() {
    MeasureMachine();
    if (Wanted("table")) {
      std::printf("\n| case | mesh | N | ms | p10-p90 | pass | stretch | result | runs | occupied |\n");
      std::printf("|---|---|---|---|---|---|---|---|---|---|\n");
      Table(BenchRows());
    }
    if (Wanted("shaders")) {
      std::printf("\n| shaded case | mesh | N | ms | p10-p90 | times f32 max | runs | occupied |\n");
      std::printf("|---|---|---|---|---|---|---|---|\n");
      Table(ShaderRows());
    }
    if (Wanted("stages")) StageTable();
    if (Wanted("calls")) CallTable();
    if (Wanted("batch")) BatchTable();
    std::printf("cuda_bench: %d rows, %d met the pass time, %d the stretch time, %d missed, %d failed or not run\n",
                rows_, passed_, stretched_, rows_ - passed_ - failed_, failed_);
    return failed_ > 0 ? 1 : 0;
  }

 private:
  bool Wanted(const char* part) const { return options_.only.empty() || options_.only == part; }
  bool Wanted(const BenchRow& row) const {
    const std::string line = absl::StrCat(row.mesh, " ", row.name, " ", row.n);
    const std::vector<std::string> filters = absl::StrSplit(options_.filter, '|');
    return std::any_of(filters.begin(), filters.end(),
                       [&](const std::string& filter) { return absl::StrContains(line, filter); });
  }
  bool TimeIsUp() const { return MsSince(begin_) / 1e3 > options_.budget_s; }

  const TriangleMesh& MeshOf(const std::string& name) {
    const auto known = made_.find(name);
    if (known != made_.end()) return known->second;
    for (const BenchMesh& mesh : meshes_) {
      if (mesh.name != name) continue;
      const TriangleMesh& made = made_.emplace(name, mesh.make()).first->second;
      std::fprintf(stderr, "%s: %zu triangles, %zu vertices\n", name.c_str(), made.triangles.size(),
                   made.positions.size());
      return made;
    }
    std::abort();
  }

  void MeasureMachine() {
    cudaDeviceProp device;
    (void)cudaGetDeviceProperties(&device, 0);
    constexpr size_t kBytes = size_t{1} << 30;
    void *there = nullptr, *here = nullptr;
    double set_ms = 0, down_ms = 0, up_ms = 0;
    if (cudaMalloc(&there, kBytes) == cudaSuccess && cudaMallocHost(&here, kBytes / 4) == cudaSuccess) {
      Marks marks(4);
      std::vector<double> set, down, up;
      for (int i = 0; i < 9; ++i) {
        marks.Set(0, nullptr);
        (void)cudaMemsetAsync(there, i, kBytes, nullptr);
        marks.Set(1, nullptr);
        (void)cudaMemcpyAsync(here, there, kBytes / 4, cudaMemcpyDeviceToHost, nullptr);
        marks.Set(2, nullptr);
        (void)cudaMemcpyAsync(there, here, kBytes / 4, cudaMemcpyHostToDevice, nullptr);
        marks.Set(3, nullptr);
        (void)marks.Wait();
        set.push_back(marks.Between(0, 1));
        down.push_back(marks.Between(1, 2));
        up.push_back(marks.Between(2, 3));
      }
      set_ms = Quantile(set, 0.5), down_ms = Quantile(down, 0.5), up_ms = Quantile(up, 0.5);
      down_rate_ = double(kBytes / 4) / down_ms;
      up_rate_ = double(kBytes / 4) / up_ms;
    }
    (void)cudaFree(there);
    (void)cudaFreeHost(here);
    std::printf("%s, %d multiprocessors; clearing %.2f TB/s; pinned copies %.1f GB/s to the host, %.1f GB/s from it\n",
                device.name, device.multiProcessorCount, double(kBytes) / set_ms / 1e9, down_rate_ / 1e6,
                up_rate_ / 1e6);
    for (const BenchMesh& mesh : meshes_) std::printf("%s: %s\n", mesh.name.c_str(), mesh.what.c_str());
    std::fflush(stdout);
  }

  void Table(const std::vector<BenchRow>& rows) {
    for (const BenchRow& row : rows) {
      if (!Wanted(row)) continue;
      ++rows_;
      const std::string head = absl::StrCat("| ", row.name, " | ", row.mesh, " | ", row.n, " | ");
      if (TimeIsUp()) {
        Fail(head, absl::DeadlineExceededError("not run: the time is up"));
        continue;
      }
      backend_.Run(0, [&] { MeasureRow(row, head); });
    }
  }

  void Fail(const std::string& head, const absl::Status& status) {
    ++failed_;
    std::printf("%s%s: %s |\n", head.c_str(), absl::StatusCodeToString(status.code()).c_str(),
                std::string(status.message()).c_str());
    std::fflush(stdout);
  }

  // Up to `repeats` runs, fewer where they are slow: a second and a half of them, but at least three.
  template <typename OneRun>
  absl::Status Repeat(OneRun&& run) {
    for (int i = 0; i < options_.warmup; ++i) {
      if (absl::Status s = run(true); !s.ok()) return s;
    }
    const auto begin = Clock::now();
    for (int i = 0; i < options_.repeats && (i < 3 || MsSince(begin) < 1500); ++i) {
      if (absl::Status s = run(false); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  // What the CPU finds, made once a mesh, coverage and resolution, and a shader that discards.
  uint64_t ExpectedOccupied(const BenchRow& row) {
    const bool discards = absl::StrContains(row.mesh, "masked") && row.request.targets.size() == 1;
    const std::string key =
        absl::StrCat(row.mesh, " ", int(row.request.coverage), " ", row.n, discards ? row.name : "");
    const auto known = occupied_.find(key);
    if (known != occupied_.end()) return known->second;
    VoxelizeRequest bits;
    bits.grid = row.request.grid;
    bits.coverage = row.request.coverage;
    if (discards) {
      bits.targets = row.request.targets;
      bits.result = ResultKind::kSparse;
    }
    bits.backend = BackendChoice::kCpu;
    const absl::StatusOr<VoxelizeResult> result = Voxelize(MeshOf(row.mesh), bits, {JobContext()});
    return occupied_[key] = result.ok() ? result->stats.occupied : 0;
  }

  void MeasureRow(const BenchRow& row, const std::string& head) {
    absl::StatusOr<std::unique_ptr<Call>> call = Call::Make(backend_, MeshOf(row.mesh), row.request);
    if (!call.ok()) return Fail(head, call.status());
    Marks marks(2);
    std::vector<double> ms;
    const absl::Status status = Repeat([&](bool warmup) {
      absl::Status s = (*call)->Run(marks, false);
      if (s.ok() && !warmup) ms.push_back(marks.Between(0, 1));
      return s;
    });
    if (!status.ok()) return Fail(head, status);
    const double median = Quantile(ms, 0.5);
    const absl::StatusOr<uint64_t> occupied = (*call)->CountOccupied();
    if (!occupied.ok()) return Fail(head, occupied.status());
    const uint64_t expected = ExpectedOccupied(row);
    if (*occupied != expected) {
      return Fail(head, absl::DataLossError(absl::StrCat(*occupied, " voxels occupied, the CPU has ", expected, ", in ",
                                                         Ms(median), " ms")));
    }
    const std::string times = absl::StrCat(Ms(median), " | ", Ms(Quantile(ms, 0.1)), "-", Ms(Quantile(ms, 0.9)), " | ");
    const bool asked = row.pass_ms > 0;
    passed_ += !asked || median <= row.pass_ms;
    stretched_ += asked && median <= row.stretch_ms;
    std::string beside;
    if (asked) {
      const char* const verdict = median <= row.stretch_ms ? "stretch met" : median <= row.pass_ms ? "met" : "MISSED";
      beside = absl::StrCat(Ms(row.pass_ms), " | ", Ms(row.stretch_ms), " | ", verdict);
    } else {
      // Beside the least that a value a voxel costs.
      double& least = ids_ms_[absl::StrCat(row.mesh, " ", row.n)];
      if (row.name == "f32 max triangle_id") least = median;
      if (least > 0) beside = absl::StrFormat("%.2f", median / least);
    }
    std::printf("%s%s%s | %zu | %llu |\n", head.c_str(), times.c_str(), beside.c_str(), ms.size(),
                static_cast<unsigned long long>(*occupied));
    std::fflush(stdout);
  }

  void StageTable() {
    std::printf("\nStages, ms (medians, events between them):\n");
    for (const BenchRow& row : StageRows()) {
      if (!Wanted(row)) continue;
      const std::string head = absl::StrCat(row.name, ", ", row.mesh, " ", row.n, ": ");
      if (TimeIsUp()) {
        Fail(head, absl::DeadlineExceededError("not run: the time is up"));
        continue;
      }
      backend_.Run(0, [&] { MeasureStages(row, head); });
    }
  }

  void MeasureStages(const BenchRow& row, const std::string& head) {
    absl::StatusOr<std::unique_ptr<Call>> call = Call::Make(backend_, MeshOf(row.mesh), row.request);
    if (!call.ok()) return Fail(head, call.status());
    const size_t steps = (*call)->steps().size();
    Marks marks(steps + 1);
    std::vector<std::vector<double>> ms(steps);
    const absl::Status status = Repeat([&](bool warmup) {
      absl::Status s = (*call)->Run(marks, true);
      for (size_t i = 0; s.ok() && !warmup && i < steps; ++i) ms[i].push_back(marks.Between(i, i + 1));
      return s;
    });
    if (!status.ok()) return Fail(head, status);
    std::printf("%s", head.c_str());
    for (size_t i = 0; i < steps; ++i)
      std::printf("%s%s %s", i == 0 ? "" : ", ", (*call)->steps()[i].first, Ms(Quantile(ms[i], 0.5)).c_str());
    std::printf("\n");
    std::fflush(stdout);
  }

  void CallTable() {
    std::printf(
        "\n| whole call | mesh | N | first ms | ms | p10-p90 | result MB | mesh MB | floor: result | floor: both |\n");
    std::printf("|---|---|---|---|---|---|---|---|---|---|\n");
    for (const BenchRow& row : WholeCallRows()) {
      if (!Wanted(row)) continue;
      const std::string head = absl::StrCat("| ", row.name, " | ", row.mesh, " | ", row.n, " | ");
      if (TimeIsUp()) {
        Fail(head, absl::DeadlineExceededError("not run: the time is up"));
        continue;
      }
      (void)MeshOf(row.mesh);
      TriangleMesh& kept = made_.at(row.mesh);
      const std::vector<Vec3f> own_normals = kept.normals;
      const bool displaced = row.request.vertex_shader.name == "displace_along_normal";
      if (displaced) AddNormals(kept);
      const std::string id = displaced ? row.mesh + " with normals" : row.mesh;
      MeasureCall(row, kept, head);
      kept.content_id = id;  // the device keeps it
      MeasureCall(row, kept, absl::StrCat("| ", row.name, " | ", row.mesh, ", kept | ", row.n, " | "));
      kept.content_id = NewMovedId(id);  // all but its positions
      MeasureCall(row, kept, absl::StrCat("| ", row.name, " | ", row.mesh, ", kept, new positions | ", row.n, " | "));
      kept.content_id.clear();
      kept.normals = own_normals;
    }
  }

  // Away from the middle: something to displace along.
  static void AddNormals(TriangleMesh& mesh) {
    mesh.normals.resize(mesh.positions.size());
    for (size_t v = 0; v < mesh.normals.size(); ++v) {
      const Vec3d d = mesh.positions[v] - Vec3d{0.5, 0.5, 0.5};
      const double length = std::sqrt(Dot(d, d));
      mesh.normals[v] = {float(d.x / length), float(d.y / length), float(d.z / length)};
    }
  }

  // Many small jobs: one batch, and one call after the other.
  void BatchTable() {
    constexpr size_t kMeshes = 1000;
    if (!absl::StrContains("batch 1000 x 500 triangles 32", options_.filter)) return;
    std::vector<TriangleMesh> meshes;
    for (uint32_t i = 0; i < kMeshes; ++i) meshes.push_back(testing::Soup(500, 3, i + 1));
    std::printf("\n| %zu meshes of 500 triangles | at | passes | launches | first ms | ms | p10-p90 | meshes/s |\n",
                kMeshes);
    std::printf("|---|---|---|---|---|---|---|---|\n");
    const Backend& cpu = *Devices().back();
    VoxelizeRequest bits;
    bits.grid.resolution = 32;
    bits.grid.fit = GridFit::kCube;
    VoxelizeRequest filled = bits, flooded = bits, shaded = bits, buckets = bits;
    filled.fill = Fill::kParity;
    flooded.fill = Fill::kFlood;
    shaded.targets[0].format = VoxelFormat::kF32;
    shaded.targets[0].blend = Blend::kMax;
    shaded.targets[0].shader.name = "position";
    shaded.targets[0].components = 3;
    buckets.result = ResultKind::kBuckets;
    VoxelizeRequest shaded_buckets = shaded;
    shaded_buckets.result = ResultKind::kBuckets;
    for (const auto& [request, what] : {std::pair{bits, std::string()},
                                        {filled, ", parity fill"},
                                        {flooded, ", flood fill"},
                                        {shaded, ", 3 x f32 max"},
                                        {buckets, ", A-buffer"},
                                        {shaded_buckets, ", A-buffer of 3 x f32"}}) {
      MeasureBatch("one batch, cuda" + what, backend_, BackendChoice::kCuda, request, meshes, kMeshes);
      MeasureBatch("batches of 64, cuda" + what, backend_, BackendChoice::kCuda, request, meshes, 64);
      for (size_t i = 0; i < kMeshes; ++i) meshes[i].content_id = absl::StrCat("small", i);
      MeasureBatch("one batch, cuda, meshes kept" + what, backend_, BackendChoice::kCuda, request, meshes, kMeshes);
      for (TriangleMesh& mesh : meshes) mesh.content_id.clear();
      MeasureBatch("single calls, cuda" + what, backend_, BackendChoice::kCuda, request, meshes, 1);
      MeasureBatch("one batch, cpu, all cores" + what, cpu, BackendChoice::kCpu, request, meshes, kMeshes);
      MeasureBatch("single calls, cpu, all cores" + what, cpu, BackendChoice::kCpu, request, meshes, 1);
    }
  }

  void MeasureBatch(const std::string& name, const Backend& backend, BackendChoice choice, VoxelizeRequest request,
                    const std::vector<TriangleMesh>& meshes, size_t together) {
    request.backend = choice;
    const JobContext job;
    std::vector<double> ms;
    std::atomic<uint64_t> failed{0};
    uint64_t passes = 0, launches = 0;
    for (int i = 0; i < 9; ++i) {
      passes = launches = 0;
      const auto begin = Clock::now();
      for (size_t first = 0; first < meshes.size(); first += together) {
        if (together == 1) {
          failed += !Voxelize(meshes[first], request, {.job = job, .backend = &backend}).ok();
          ++passes;
          continue;
        }
        std::vector<BatchItem> items;
        for (size_t k = first; k < std::min(meshes.size(), first + together); ++k) {
          items.push_back({&meshes[k], &request, &job, {}, [&](const absl::StatusOr<VoxelizeResult>& result) {
                             failed += !result.ok();
                           }});
        }
        const BatchStats stats = VoxelizeBatch(backend, items, 0);
        passes += stats.passes;
        launches += stats.launches.value_or(0);
      }
      ms.push_back(MsSince(begin));
    }
    const double first = ms.front();
    ms.erase(ms.begin());
    if (failed > 0) return Fail("| " + name + " | ", absl::DataLossError(absl::StrCat(failed.load(), " jobs failed")));
    std::printf("| %s | 32 | %llu | %s | %s | %s | %s-%s | %.0f |\n", name.c_str(),
                static_cast<unsigned long long>(passes), launches == 0 ? "" : absl::StrCat(launches).c_str(),
                Ms(first).c_str(), Ms(Quantile(ms, 0.5)).c_str(), Ms(Quantile(ms, 0.1)).c_str(),
                Ms(Quantile(ms, 0.9)).c_str(), double(meshes.size()) / Quantile(ms, 0.5) * 1e3);
    std::fflush(stdout);
  }

  void MeasureCall(const BenchRow& row, const TriangleMesh& mesh, const std::string& head) {
    std::vector<double> ms;
    double result_bytes = 0;
    for (int i = 0; i < 12 && (i < 4 || ms.back() < 500); ++i) {
      const auto begin = Clock::now();
      const absl::StatusOr<VoxelizeResult> result = Voxelize(mesh, row.request, {JobContext()});
      ms.push_back(MsSince(begin));
      if (!result.ok()) return Fail(head, result.status());
      result_bytes = 0;
      for (const auto& bytes : ArraysOf(*result)) result_bytes += double(bytes.size());
    }
    const double first = ms.front();
    ms.erase(ms.begin());
    const double mesh_bytes =
        double(mesh.positions.size()) * sizeof(Vec3d) + double(mesh.triangles.size()) * 3 * sizeof(uint32_t);
    const double down = result_bytes / down_rate_, up = mesh_bytes / up_rate_;
    std::printf("%s%s | %s | %s-%s | %.1f | %.1f | %s | %s |\n", head.c_str(), Ms(first).c_str(),
                Ms(Quantile(ms, 0.5)).c_str(), Ms(Quantile(ms, 0.1)).c_str(), Ms(Quantile(ms, 0.9)).c_str(),
                result_bytes / 1e6, mesh_bytes / 1e6, Ms(down).c_str(), Ms(down + up).c_str());
    std::fflush(stdout);
  }

  const Options& options_;
  const Backend& backend_;
  const Clock::time_point begin_ = Clock::now();
  std::vector<BenchMesh> meshes_;
  std::map<std::string, TriangleMesh> made_;
  std::map<std::string, uint64_t> occupied_;
  std::map<std::string, double> ids_ms_;  // by mesh and resolution, of f32 max triangle_id
  double down_rate_ = 1, up_rate_ = 1;    // bytes a millisecond
  int rows_ = 0, passed_ = 0, stretched_ = 0, failed_ = 0;
};

bool Parse(int argc, char** argv, Options& options) {
  for (int i = 1; i < argc; i += 2) {
    if (i + 1 == argc) return false;
    const std::string argument = argv[i], value = argv[i + 1];
    if (argument == "--bunny") {
      options.bunny = value;
    } else if (argument == "--cow") {
      options.cow = value;
    } else if (argument == "--filter") {
      options.filter = value;
    } else if (argument == "--only") {
      options.only = value;
    } else if (argument == "--budget") {
      options.budget_s = std::atof(value.c_str());
    } else if (argument == "--memory") {
      cuda::LimitMemory(std::strtoull(value.c_str(), nullptr, 10));
    } else if (argument == "--repeats") {
      options.repeats = std::atoi(value.c_str());
    } else if (argument == "--warmup") {
      options.warmup = std::atoi(value.c_str());
    } else {
      return false;
    }
  }
  return true;
}

int Main(int argc, char** argv) {
  Options options;
  if (!Parse(argc, argv, options)) {
    std::fprintf(stderr, "cuda_bench: unknown or incomplete option; see the head of cuda_bench.cpp\n");
    return 1;
  }
  const absl::StatusOr<const Backend*> backend = SelectBackend(BackendChoice::kCuda);
  if (!backend.ok()) {
    std::printf("SKIPPED: no CUDA device (%s)\n", std::string(backend.status().message()).c_str());
    return 77;
  }
  return Bench(options, **backend).Run();
}

}  // namespace
}  // namespace voxelpipe::gpu

int main(int argc, char** argv) {
  return voxelpipe::gpu::Main(argc, argv);
}
