// Plans against what runs take: the peak of counting allocators over many random jobs, honest and hostile
// (property/plan_jobs.h).
//
// usage: plan_bounds [--jobs N] [--seed S] [--backend cpu|cuda] [--only SEED] [--verbose]
// Prints the distribution of measured / planned over the jobs that take 16 MiB or more, and the worst ones; and how
// many take more than their plan and what they took from their budget while they counted their lists. Exit 1 if a job
// takes more than 1.25 times its plan, or more than 5 % of them less than a third of it; 77 where there is no CUDA
// device or nothing can be counted.
#include <malloc.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/memory_budget.h"
#include "grid/page_pool.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "property/plan_jobs.h"
#include "support/counting_memory.h"
#if defined(VOXELPIPE_HAVE_CUDA)
#include "cuda/device/device.h"
#include "cuda/device/pinned.h"
#endif

namespace voxelpipe::testing {
namespace {

constexpr double kMaxMeasured = 1.25, kMaxPlanned = 3, kShareWithin = 0.95;
constexpr uint64_t kMinBytes = 16 << 20;

struct Options {
  int64_t jobs = 60;
  uint64_t seed = 1;
  bool cuda = false, verbose = false, only = false;
};

class Swallow final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
  absl::Status Write(size_t, std::span<const uint8_t>) override { return absl::OkStatus(); }
};

// Of the CUDA allocations: what is taken now, and the most since ResetPeaks.
uint64_t DeviceBytes() {
#if defined(VOXELPIPE_HAVE_CUDA)
  return cuda::MemoryTaken();
#else
  return 0;
#endif
}

uint64_t DevicePeak() {
#if defined(VOXELPIPE_HAVE_CUDA)
  return cuda::MemoryPeak();
#else
  return 0;
#endif
}

void ResetPeaks() {
  ResetAllocatedPeak();
#if defined(VOXELPIPE_HAVE_CUDA)
  cuda::ResetMemoryPeak();
#endif
}

struct Outcome {
  uint64_t seed = 0, planned = 0, charged_later = 0, host = 0, device = 0;
  bool hostile = false;
  std::string text;
  uint64_t measured() const { return host + device; }
  double taken() const { return double(measured()) / double(planned); }  // of the plan
  double taken_of_charged() const { return double(measured()) / double(planned + charged_later); }
};

// What the job takes besides its mesh.
absl::StatusOr<Outcome> Run(uint64_t seed, const Options& options) {
  PlanJob job = MakePlanJob(seed);
  job.request.backend = options.cuda ? BackendChoice::kCuda : BackendChoice::kCpu;
  Outcome out;
  out.seed = seed;
  out.hostile = job.hostile;
  out.text = job.text;
#if defined(VOXELPIPE_HAVE_CUDA)
  if (options.cuda) cuda::ForgetPinned();  // so that new pinned memory is counted
#endif
  ReleaseIdlePages();
  malloc_trim(0);
  ResetPeaks();
  const uint64_t host = AllocatedBytes(), device = DeviceBytes();
  const auto on_plan = [&](const Plan& plan) {
    out.planned = plan.peak_bytes;
    return absl::OkStatus();
  };
  MemoryBudget budget(UINT64_MAX);
  JobContext context;
  context.set_memory(&budget);
  absl::Status status;
  if (job.streamed) {
    Swallow sink;
    status = VoxelizeTo(job.mesh, job.request, {context, job.limits, on_plan}, sink).status();
  } else {
    status = Voxelize(job.mesh, job.request, {context, job.limits, on_plan}).status();
  }
  if (!status.ok()) return status;
  out.charged_later = budget.peak_bytes();
  out.host = AllocatedPeak() - host;
  out.device = std::max(DevicePeak(), device) - device;
  return out;
}

double MiB(uint64_t bytes) {
  return double(bytes) / double(1 << 20);
}

void Print(const Outcome& job) {
  std::printf("%8llu  %9.1f  %9.1f  %9.1f  %9.1f  %6.2f  %s\n", static_cast<unsigned long long>(job.seed),
              MiB(job.planned), MiB(job.charged_later), MiB(job.host), MiB(job.device), job.taken(), job.text.c_str());
  std::fflush(stdout);
}

// Of `jobs` by ascending share taken: the distribution in one line.
void PrintDistribution(const char* name, const std::vector<Outcome>& jobs) {
  if (jobs.empty()) return;
  const auto at = [&](double share) { return jobs[size_t(share * double(jobs.size() - 1) + 0.5)].taken(); };
  std::printf("%-8s %5zu jobs  %6.2f %6.2f %6.2f %6.2f %6.2f %6.2f %6.2f\n", name, jobs.size(), at(0), at(0.05),
              at(0.25), at(0.5), at(0.75), at(0.95), at(1));
}

int Judge(std::vector<Outcome> jobs, int64_t drawn, int64_t failed) {
  std::sort(jobs.begin(), jobs.end(), [](const Outcome& a, const Outcome& b) { return a.taken() < b.taken(); });
  std::printf("\nmeasured / planned     least   5 %%   25 %%   50 %%   75 %%   95 %%   most\n");
  std::vector<Outcome> honest, hostile;
  for (const Outcome& job : jobs) (job.hostile ? hostile : honest).push_back(job);
  PrintDistribution("all", jobs);
  PrintDistribution("honest", honest);
  PrintDistribution("hostile", hostile);
  const size_t shown = std::min<size_t>(12, jobs.size());
  std::printf("\n    seed    planned    charged       host     device   ratio  (MiB)\n");
  for (size_t i = 0; i < shown; ++i) Print(jobs[i]);
  std::printf("     ...\n");
  for (size_t i = jobs.size() - std::min(shown, jobs.size() - shown); i < jobs.size(); ++i) Print(jobs[i]);
  const auto over = std::count_if(jobs.begin(), jobs.end(), [](const auto& job) { return job.taken() > kMaxMeasured; });
  const auto uncharged =
      std::count_if(jobs.begin(), jobs.end(), [](const auto& job) { return job.taken_of_charged() > kMaxMeasured; });
  const auto under =
      std::count_if(jobs.begin(), jobs.end(), [](const auto& job) { return job.taken() * kMaxPlanned < 1; });
  const double within = jobs.empty() ? 1 : 1 - double(under) / double(jobs.size());
  std::printf(
      "plan_bounds: %lld jobs, %zu of 16 MiB or more, %lld failed; %lld take more than %.2f of their plan, "
      "%lld of it and of what they were charged later; %.1f %% at least a third of their plan\n",
      static_cast<long long>(drawn), jobs.size(), static_cast<long long>(failed), static_cast<long long>(over),
      kMaxMeasured, static_cast<long long>(uncharged), 100 * within);
  return over > 0 || failed > 0 || within < kShareWithin || jobs.empty() ? 1 : 0;
}

int Main(const Options& options) {
  if (!CountsMemory()) {
    std::printf("plan_bounds: a sanitizer's allocator does not count\n");
    return 77;
  }
  if (options.cuda && !SelectBackend(BackendChoice::kCuda).ok()) {
    std::printf("plan_bounds: no CUDA device\n");
    return 77;
  }
  // Threads, code and tables are no part of a plan: the first job of each kind brings them.
  for (uint64_t warm = 0; warm < 6; ++warm) (void)Run(1000003 + warm, options);
  std::vector<Outcome> jobs;
  int64_t failed = 0;
  for (int64_t i = 0; i < options.jobs; ++i) {
    const uint64_t seed = options.only ? options.seed : options.seed * 1000000 + uint64_t(i);
    const absl::StatusOr<Outcome> job = Run(seed, options);
    if (!job.ok()) {
      std::printf("%8llu  %s: %s\n", static_cast<unsigned long long>(seed), MakePlanJob(seed).text.c_str(),
                  job.status().ToString().c_str());
      ++failed;
      continue;
    }
    if (options.verbose) Print(*job);
    if (options.only) {
      Print(*job);
      return 0;
    }
    if (std::max(job->measured(), job->planned) >= kMinBytes) jobs.push_back(*job);
  }
  return Judge(std::move(jobs), options.jobs, failed);
}

}  // namespace
}  // namespace voxelpipe::testing

int main(int argc, char** argv) {
  voxelpipe::testing::Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string_view name = argv[i];
    const char* const value = i + 1 < argc ? argv[i + 1] : "";
    if (name == "--verbose") {
      options.verbose = true;
    } else if (name == "--jobs") {
      options.jobs = std::atoll(value), ++i;
    } else if (name == "--seed") {
      options.seed = std::strtoull(value, nullptr, 10), ++i;
    } else if (name == "--only") {
      options.only = true, options.jobs = 1, options.seed = std::strtoull(value, nullptr, 10), ++i;
    } else if (name == "--backend" && (std::string_view(value) == "cpu" || std::string_view(value) == "cuda")) {
      options.cuda = std::string_view(value) == "cuda", ++i;
    } else {
      std::fprintf(stderr, "usage: plan_bounds [--jobs N] [--seed S] [--backend cpu|cuda] [--only SEED] [--verbose]\n");
      return 2;
    }
  }
  return voxelpipe::testing::Main(options);
}
