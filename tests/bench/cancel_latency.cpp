// How long a run goes on after it was cancelled: for each kind of request on a large grid (argv[2]: part of the names
// of those that are wanted), cancels at a hundred (or argv[1]) moments of the run and prints the longest processor time
// and the longest wall time from there to the return, as a table. One thread, so that both are those of one core. The
// first run of a case, which is not cancelled, finds fresh pages; the others mostly those of the runs before, as in a
// server. `fresh` is the same with all pages fresh.
#include <ctime>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "bench/meshes.h"
#include "grid/page_pool.h"
#include "mesh/flatten_job.h"
#include "pipeline/voxelize.h"

namespace voxelpipe::bench {
namespace {

double WallMs() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double CpuMs() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

struct Case {
  std::string name;
  VoxelizeRequest request;
};

// `components` of f32, 0 for plain bits.
VoxelizeRequest Request(int64_t resolution, Fill fill, ResultKind result, int components) {
  VoxelizeRequest request;
  request.grid.resolution = resolution;
  request.fill = fill;
  request.result = result;
  request.threads = 1;
  request.backend = BackendChoice::kCpu;
  if (components > 0) {
    request.targets[0].format = VoxelFormat::kF32;
    request.targets[0].components = components;
    request.targets[0].blend = Blend::kAdd;
    request.targets[0].shader = {"normal", {}};
  }
  return request;
}

using Run = std::function<absl::Status(const JobContext& job)>;

struct Worst {
  double cpu_ms = 0, wall_ms = 0;
  int cancelled = 0;
};

// Cancels at so many moments of a run that takes `whole` ms.
Worst CancelAt(const Run& run, double whole, int moments, bool fresh) {
  Worst worst;
  for (int i = 0; i < moments; ++i) {
    if (fresh) ReleaseIdlePages();
    JobContext job;
    double wall = 0, cpu = 0;
    std::thread canceller([&] {
      std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(whole * (i + 0.5) / moments));
      wall = WallMs();
      cpu = CpuMs();
      job.Cancel();
    });
    const bool ended = !run(job).ok();
    const double wall_end = WallMs(), cpu_end = CpuMs();
    canceller.join();
    if (!ended) continue;
    ++worst.cancelled;
    worst.cpu_ms = std::max(worst.cpu_ms, cpu_end - cpu);
    worst.wall_ms = std::max(worst.wall_ms, wall_end - wall);
  }
  return worst;
}

void Measure(const char* mesh_name, const std::string& name, const Run& run, int moments) {
  const double began = WallMs();
  {
    const JobContext job;
    if (const absl::Status s = run(job); !s.ok()) {
      std::printf("| %s | %s | %s |\n", mesh_name, name.c_str(), s.ToString().c_str());
      return;
    }
  }
  const double first = WallMs() - began;
  const double again = WallMs();
  {
    const JobContext job;
    run(job).IgnoreError();
  }
  const double second = WallMs() - again;
  const Worst reused = CancelAt(run, second, moments, /*fresh=*/false);
  const Worst fresh = CancelAt(run, first, std::max(1, moments / 3), /*fresh=*/true);
  std::printf("| %s | %s | %.0f | %d | %.1f | %.1f | %d | %.1f | %.1f |\n", mesh_name, name.c_str(), first,
              reused.cancelled, reused.cpu_ms, reused.wall_ms, fresh.cancelled, fresh.cpu_ms, fresh.wall_ms);
  std::fflush(stdout);
}

void Measure(const char* mesh_name, const TriangleMesh& mesh, const Case& one, int moments) {
  Measure(
      mesh_name, one.name, [&](const JobContext& job) { return Voxelize(mesh, one.request, {job}).status(); }, moments);
}

// As a file of one primitive would be loaded.
Scene SceneOf(const TriangleMesh& mesh) {
  Scene scene;
  Primitive primitive;
  for (const Vec3d& p : mesh.positions) primitive.positions.push_back({float(p.x), float(p.y), float(p.z)});
  for (const auto& triangle : mesh.triangles) primitive.triangles.push_back({triangle[0], triangle[1], triangle[2]});
  scene.meshes = {Mesh{"", {std::move(primitive)}}};
  scene.nodes.resize(1);
  scene.nodes[0].mesh = 0;
  scene.roots = {0};
  return scene;
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  using namespace voxelpipe;
  const int moments = argc > 1 ? std::atoi(argv[1]) : 100;
  const std::string only = argc > 2 ? argv[2] : "";  // part of a case's name
  const auto dense = ResultKind::kDense;
  const auto sparse = ResultKind::kSparse, buckets = ResultKind::kBuckets;
  const std::vector<bench::Case> cases = {
      {"bits 512", bench::Request(512, Fill::kNone, dense, 0)},
      {"bits 1024", bench::Request(1024, Fill::kNone, dense, 0)},
      {"bits parity 1024", bench::Request(1024, Fill::kParity, dense, 0)},
      {"bits flood 512", bench::Request(512, Fill::kFlood, dense, 0)},
      {"bits flood 1024", bench::Request(1024, Fill::kFlood, dense, 0)},
      {"f32 640 (1 GB)", bench::Request(640, Fill::kNone, dense, 1)},
      {"f32 flood 512", bench::Request(512, Fill::kFlood, dense, 1)},
      {"f32x3 256", bench::Request(256, Fill::kNone, dense, 3)},
      {"f32x3 384", bench::Request(384, Fill::kNone, dense, 3)},
      {"f32x3 8 (few large tiles)", bench::Request(8, Fill::kNone, dense, 3)},
      {"f32x3 flood 256", bench::Request(256, Fill::kFlood, dense, 3)},
      {"sparse bits 1024", bench::Request(1024, Fill::kNone, sparse, 0)},
      {"sparse f32x3 256", bench::Request(256, Fill::kNone, sparse, 3)},
      {"sparse f32x3 512", bench::Request(512, Fill::kNone, sparse, 3)},
      {"buckets f32x3 256", bench::Request(256, Fill::kNone, buckets, 3)},
      {"buckets bits 512", bench::Request(512, Fill::kNone, buckets, 0)},
      {"buckets f32x3 8", bench::Request(8, Fill::kNone, buckets, 3)},
  };
  // With another vertex shader than identity, shading is a stage of its own.
  bench::Case displaced{"bits 256, displaced", bench::Request(256, Fill::kNone, dense, 0)};
  displaced.request.vertex_shader = {"displace_along_normal", {}};
  std::printf(
      "| mesh | case | first run, ms | cancelled | worst CPU ms | worst wall ms | cancelled, fresh | worst CPU ms | "
      "worst wall ms |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|\n");
  const TriangleMesh sphere = bench::BumpySphere(1'000'000);
  for (const bench::Case& one : cases) {
    if (one.name.find(only) != std::string::npos) bench::Measure("sphere1M", sphere, one, moments);
  }
  const bool shades = displaced.name.find(only) != std::string::npos;
  const bool flattens = std::string("flatten").find(only) != std::string::npos;
  if (!shades && !flattens) return 0;
  const TriangleMesh large = bench::BumpySphere(10'000'000);
  if (shades) bench::Measure("sphere10M", large, displaced, moments);
  if (flattens) {
    const Scene scene = bench::SceneOf(large);
    const bench::Run flatten = [&](const JobContext& job) { return FlattenFor(job, scene, LoadLimits()).status(); };
    bench::Measure("sphere10M", "flatten", flatten, moments);
  }
  return 0;
}
