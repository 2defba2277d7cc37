// Whole calls of the CUDA backend, from a mesh in memory to the result in memory, at sizes beside the limits where a
// call changes its way: slabs, pinned memory, caches.
//
// usage: whole_calls_bench [OPTION]...
//   --bunny FILE    a bunny of 69,451 triangles, in place of a generated sphere
//   --filter TEXT   only rows whose line "MESH CASE N" holds TEXT; of several, with | between them, one
//   --repeats N     measured calls a row (30)      --warmup N   calls before them (3)
//   --backend NAME  cuda or cpu                    --small      grids of 32, small meshes
//   --sum           a checksum of each row's first results, which have to be alike, to compare programs
//   --hold          a result is released when the next call has ended, in place of before it
//
// Wall clock of Voxelize(), median and 10th and 90th percentiles; a row whose calls take long has fewer. "first": the
// first call of the row. "kept": the device keeps the mesh; otherwise each call sends it.
// Exit: 0, 1 where a call failed, 77 where there is no such backend.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "bench/inputs/one_target.h"
#include "gpu/cases/bench_meshes.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

using Clock = std::chrono::steady_clock;

double MsSince(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

double Quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[size_t(q * double(values.size() - 1) + 0.5)];
}

struct Options {
  std::string bunny, filter;
  BackendChoice backend = BackendChoice::kCuda;
  int repeats = 30, warmup = 3;
  bool small = false, sum = false, hold = false;
};

struct Row {
  std::string name, mesh;
  int64_t n;
  bool kept;
  VoxelizeRequest request;
};

std::vector<Row> Rows(bool small) {
  constexpr auto f32 = VoxelFormat::kF32;
  const auto dense = ResultKind::kDense, sparse = ResultKind::kSparse;
  const VoxelizeRequest ids = bench::OneTarget(f32, 1, Blend::kMax, "triangle_id", sparse);
  const VoxelizeRequest normals = bench::OneTarget(f32, 3, Blend::kReplace, "normal", sparse);
  const VoxelizeRequest average = bench::OneTarget(f32, 3, Blend::kAverage, "normal", sparse);
  const VoxelizeRequest colors = bench::OneTarget(VoxelFormat::kU8, 4, Blend::kReplace, "base_color", sparse);
  const VoxelizeRequest dense_ids = bench::OneTarget(f32, 1, Blend::kMax, "triangle_id", dense);
  std::vector<Row> rows;
  const auto add = [&](const char* name, const char* mesh, int64_t n, bool kept, const VoxelizeRequest& request) {
    rows.push_back({name, small ? "bunny" : mesh, small ? 32 : n, kept, request});
    rows.back().request.grid = UnitCube(rows.back().n);
  };
  for (const int64_t n : {512, 960, 992, 1024, 1040}) add("sparse f32 max", "shaded2M", n, true, ids);
  for (const int64_t n : {960, 992, 1024}) add("sparse f32 max", "shaded2M", n, false, ids);
  for (const int64_t n : {896, 1024, 1280}) add("sparse f32x3 replace normal", "shaded2M", n, true, normals);
  for (const int64_t n : {896, 1024}) add("sparse f32x3 average normal", "shaded2M", n, true, average);
  for (const int64_t n : {512, 1024, 1600, 2048}) add("sparse f32 max", "bunny", n, true, ids);
  add("sparse f32 max", "sphere10M", 1024, true, ids);
  for (const bool kept : {true, false}) add("sparse u8x4 replace base_color", "shaded2M", 512, kept, colors);
  for (const bool kept : {true, false}) add("sparse f32x3 replace normal", "shaded2M", 512, kept, normals);
  for (const int64_t n : {512, 1008, 1024, 1040}) {
    for (const bool kept : {true, false}) add("dense f32 max", "bunny", n, kept, dense_ids);
  }
  VoxelizeRequest filled;
  for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
    filled.fill = fill;
    const char* const name = fill == Fill::kParity ? "dense bit, parity" : "dense bit, nonzero";
    for (const char* mesh : {"bunny", "bunny1M"}) add(name, mesh, 1024, true, filled);
    for (const char* mesh : {"sphere10M", "bodies"}) add(name, mesh, 512, true, filled);
  }
  return rows;
}

// 500 closed bodies that overlap, 13.6 M triangles, many of them slivers.
TriangleMesh Bodies() {
  TriangleMesh mesh;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> radius(0.04, 0.09), center(0.1, 0.9);
  for (uint32_t i = 0; i < 500; ++i) {
    const TriangleMesh body = testing::BumpySphere(83, i + 1);
    const double r = radius(random), x = center(random), y = center(random), z = center(random);
    const auto first = uint32_t(mesh.positions.size());
    for (const Vec3d& p : body.positions) mesh.positions.push_back(p * r + Vec3d{x, y, z});
    for (const auto& t : body.triangles) mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  }
  return testing::MakeMesh(std::move(mesh.positions), std::move(mesh.triangles));
}

uint64_t Checksum(const VoxelizeResult& result) {
  uint64_t sum = 0xcbf29ce484222325;
  for (const auto& bytes : ArraysOf(result)) {
    for (size_t at = 0; at < bytes.size(); at += sizeof(uint64_t)) {
      uint64_t word = 0;
      std::memcpy(&word, bytes.data() + at, std::min(sizeof word, bytes.size() - at));
      sum = (sum ^ word) * 0x100000001b3;
      sum ^= sum >> 29;
    }
  }
  return sum;
}

class Bench {
 public:
  Bench(const Options& options, const Backend& backend)
      : options_(options), backend_(backend), meshes_(BenchMeshes(options.bunny, "")) {
    meshes_.push_back({"bodies", "500 overlapping bodies", Bodies});
  }

  int Run() {
    std::printf("| whole call | mesh | N | first ms | ms | p10-p90 | stages ms | layers a slab | result MB |%s\n",
                options_.sum ? " sum |" : "");
    std::printf("|---|---|---|---|---|---|---|---|---|%s\n", options_.sum ? "---|" : "");
    for (const Row& row : Rows(options_.small)) {
      if (!Wanted(row)) continue;
      const absl::Status measured = Measure(row);
      if (measured.ok()) continue;
      failed_ = true;
      std::printf("| %s | %s | %lld | FAILED: %s |\n", row.name.c_str(), row.mesh.c_str(),
                  static_cast<long long>(row.n), std::string(measured.message()).c_str());
    }
    return failed_ ? 1 : 0;
  }

 private:
  bool Wanted(const Row& row) const {
    const std::string line = absl::StrCat(row.mesh, row.kept ? " kept " : " ", row.name, " ", row.n);
    const std::vector<std::string> filters = absl::StrSplit(options_.filter, '|');
    return std::any_of(filters.begin(), filters.end(),
                       [&](const std::string& filter) { return absl::StrContains(line, filter); });
  }

  TriangleMesh& MeshOf(const std::string& name) {
    const auto known = made_.find(name);
    if (known != made_.end()) return known->second;
    for (const BenchMesh& mesh : meshes_) {
      if (mesh.name == name) return made_.emplace(name, mesh.make()).first->second;
    }
    std::abort();
  }

  absl::Status Measure(const Row& row) {
    constexpr double kLong = 2000;  // ms of all measured calls of a row
    TriangleMesh& mesh = MeshOf(row.mesh);
    mesh.content_id = row.kept ? row.mesh : "";
    int64_t depth = 0;
    const auto on_plan = [&depth](const Plan& plan) {
      depth = plan.slab_depth;
      return absl::OkStatus();
    };
    std::vector<double> ms;
    std::map<std::string, std::vector<double>> stages;
    double first = 0, all = 0, bytes = 0;
    uint64_t sum = 0;
    std::optional<VoxelizeResult> held;
    for (int i = 0; i < options_.warmup + options_.repeats && (all < kLong || ms.size() < 3); ++i) {
      const auto begin = Clock::now();
      absl::StatusOr<VoxelizeResult> result =
          Voxelize(mesh, row.request, {.job = job_, .on_plan = on_plan, .backend = &backend_});
      const double took = MsSince(begin);
      if (!result.ok()) return result.status();
      if (i == 0) {
        first = took;
        for (const auto& array : ArraysOf(*result)) bytes += double(array.size());
      }
      if (options_.sum && i < 2) {
        const uint64_t before = std::exchange(sum, Checksum(*result));
        if (i > 0 && sum != before) return absl::DataLossError("two calls gave different results");
      }
      if (i >= options_.warmup) {
        ms.push_back(took);
        all += took;
        for (const auto& [stage, of_stage] : result->stats.stages) stages[stage].push_back(of_stage);
      }
      if (options_.hold) held = *std::move(result);
    }
    std::string text;
    for (const auto& [stage, times] : stages) {
      absl::StrAppend(&text, text.empty() ? "" : ", ", stage, " ", absl::StrFormat("%.2f", Quantile(times, 0.5)));
    }
    std::printf("| %s | %s%s | %lld | %.2f | %.2f | %.2f-%.2f | %s | %lld | %.1f |", row.name.c_str(), row.mesh.c_str(),
                row.kept ? ", kept" : "", static_cast<long long>(row.n), first, Quantile(ms, 0.5), Quantile(ms, 0.1),
                Quantile(ms, 0.9), text.c_str(), static_cast<long long>(depth), bytes / 1e6);
    if (options_.sum) std::printf(" %016llx |", static_cast<unsigned long long>(sum));
    std::printf("\n");
    std::fflush(stdout);
    return absl::OkStatus();
  }

  const Options& options_;
  const Backend& backend_;
  const JobContext job_;
  std::vector<BenchMesh> meshes_;
  std::map<std::string, TriangleMesh> made_;
  bool failed_ = false;
};

bool Parse(int argc, char** argv, Options& options) {
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--small" || name == "--sum" || name == "--hold") {
      (name == "--small" ? options.small : name == "--sum" ? options.sum : options.hold) = true;
      continue;
    }
    if (++i == argc) return false;
    const std::string value = argv[i];
    if (name == "--bunny") {
      options.bunny = value;
    } else if (name == "--filter") {
      options.filter = value;
    } else if (name == "--repeats") {
      options.repeats = std::max(1, std::atoi(value.c_str()));
    } else if (name == "--warmup") {
      options.warmup = std::max(0, std::atoi(value.c_str()));
    } else if (name == "--backend" && (value == "cpu" || value == "cuda")) {
      options.backend = value == "cpu" ? BackendChoice::kCpu : BackendChoice::kCuda;
    } else {
      return false;
    }
  }
  return true;
}

int Main(int argc, char** argv) {
  Options options;
  if (!Parse(argc, argv, options)) {
    std::fprintf(stderr, "whole_calls_bench: unknown or incomplete option; see the head of whole_calls_bench.cpp\n");
    return 1;
  }
  const absl::StatusOr<const Backend*> backend = SelectBackend(options.backend);
  if (!backend.ok()) {
    std::printf("SKIPPED: %s\n", std::string(backend.status().message()).c_str());
    return 77;
  }
  return Bench(options, **backend).Run();
}

}  // namespace
}  // namespace voxelpipe::gpu

int main(int argc, char** argv) {
  return voxelpipe::gpu::Main(argc, argv);
}
