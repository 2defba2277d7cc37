// How long a run goes on after it was cancelled: for each kind of request on a large grid, cancels at a hundred (or argv[1]) moments of the run and prints
// the longest processor time and the longest wall time from there to the return. One thread, so that both are those of one core.
#include <ctime>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "bench/meshes.h"
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

VoxelizeRequest Request(int64_t resolution, Fill fill, ResultKind result, bool shaded) {
  VoxelizeRequest request;
  request.grid.resolution = resolution;
  request.fill = fill;
  request.result = result;
  request.threads = 1;
  request.backend = BackendChoice::kCpu;
  if (shaded) {
    request.targets[0].format = VoxelFormat::kF32;
    request.targets[0].components = 3;
    request.targets[0].blend = Blend::kAdd;
    request.targets[0].shader = {"normal", {}};
  }
  return request;
}

void Measure(const char* mesh_name, const TriangleMesh& mesh, const Case& one, int moments) {
  const double began = WallMs();
  {
    const JobContext job;
    if (const auto s = Voxelize(mesh, one.request, job).status(); !s.ok()) {
      std::printf("%-10s %-28s %s\n", mesh_name, one.name.c_str(), s.ToString().c_str());
      return;
    }
  }
  const double whole = WallMs() - began;
  double worst_wall = 0, worst_cpu = 0, at = 0;
  int cancelled = 0;
  for (int i = 0; i < moments; ++i) {
    JobContext job;
    double wall = 0, cpu = 0;
    std::thread canceller([&] {
      std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(whole * (i + 0.5) / moments));
      wall = WallMs();
      cpu = CpuMs();
      job.Cancel();
    });
    const bool ended = !Voxelize(mesh, one.request, job).ok();
    const double wall_end = WallMs(), cpu_end = CpuMs();
    canceller.join();
    if (!ended) continue;
    ++cancelled;
    if (cpu_end - cpu > worst_cpu) at = (i + 0.5) / moments;
    worst_cpu = std::max(worst_cpu, cpu_end - cpu);
    worst_wall = std::max(worst_wall, wall_end - wall);
  }
  std::printf("%-10s %-28s whole %8.1f ms  cancelled %3d  worst cpu %7.1f ms (at %2.0f %%)  worst wall %7.1f ms\n",
              mesh_name, one.name.c_str(), whole, cancelled, worst_cpu, at * 100, worst_wall);
  std::fflush(stdout);
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  using namespace voxelpipe;
  const int moments = argc > 1 ? std::atoi(argv[1]) : 100;
  const std::string only = argc > 2 ? argv[2] : "";  // part of a case's name
  const auto dense = ResultKind::kDense;
  const std::vector<bench::Case> cases = {
      {"bits 1024", bench::Request(1024, Fill::kNone, dense, false)},
      {"bits parity 1024", bench::Request(1024, Fill::kParity, dense, false)},
      {"bits flood 512", bench::Request(512, Fill::kFlood, dense, false)},
      {"f32x3 256", bench::Request(256, Fill::kNone, dense, true)},
      {"f32x3 8 (few large tiles)", bench::Request(8, Fill::kNone, dense, true)},
      {"f32x3 flood 256", bench::Request(256, Fill::kFlood, dense, true)},
      {"sparse f32x3 256", bench::Request(256, Fill::kNone, ResultKind::kSparse, true)},
      {"buckets f32x3 256", bench::Request(256, Fill::kNone, ResultKind::kBuckets, true)},
      {"buckets f32x3 8", bench::Request(8, Fill::kNone, ResultKind::kBuckets, true)},
  };
  const TriangleMesh sphere = bench::BumpySphere(1'000'000);
  for (const bench::Case& one : cases) {
    if (one.name.find(only) != std::string::npos) bench::Measure("sphere1M", sphere, one, moments);
  }
  return 0;
}
