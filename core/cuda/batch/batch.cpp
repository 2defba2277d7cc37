// Divides the items of a batch into passes, runs them, and returns the items that must run alone.
#include "cuda/batch/batch.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <ctime>
#include <memory>
#include <new>
#include <optional>
#include <utility>

#include "base/wall_clock.h"
#include "cuda/batch/batch_member.h"
#include "cuda/batch/batch_pass.h"

namespace voxelpipe::cuda {
namespace {

// Size of a pass. A pass ends before the item that would exceed its limits; the rest takes further passes.
struct PassSize {
  uint64_t words = 0, triangles = 0, vertices = 0;
  uint64_t voxels = 0, fragment_words = 0;  // of items with fragments

  void Add(const BatchMember& m) {
    triangles += m.triangles();
    vertices += m.vertices();
    if (m.path != BatchPath::kRows) {
      voxels += m.plan.grid.voxels();
      fragment_words += m.fragment_words();
    }
    if (m.path != BatchPath::kFragments) words += m.grid_words() + m.target_words();
  }
  bool FitsInto(const PassSize& most) const {
    return words <= most.words && triangles <= most.triangles && vertices <= most.vertices && voxels <= most.voxels &&
           fragment_words <= most.fragment_words;
  }
};

PassSize MostOfPass(const DeviceInfo& device) {
  PassSize most;
  most.words = 1 << 26;
  most.triangles = most.vertices = 1 << 24;
  most.voxels = UINT32_MAX;  // numbers of voxels, and one more, have 32 bits
  most.fragment_words = std::min<uint64_t>(1 << 30, device.memory_bytes / 16);
  return most;
}

double CpuMs() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

// Runs one pass and delivers results to its members, except those that it adds to `alone`.
void RunPass(const DeviceInfo& device, std::span<const std::unique_ptr<BatchMember>> members, BatchStats& stats,
             std::vector<const BatchItem*>& alone) {
  for (const auto& member : members) member->item->job->Report(member->stage(), 0);
  const double wall = WallMs(), cpu = CpuMs();
  const uint64_t launches = LaunchesOfThread();
  absl::StatusOr<DeviceUse> use = DeviceUse::Begin(device.ordinal);
  std::optional<BatchPass> pass;
  absl::Status status = use.status();
  if (use.ok()) status = pass.emplace(device, *std::move(use), members).Run();
  if (!status.ok()) pass.reset();  // frees its memory for the items that run alone
  ++stats.passes;
  stats.launches = stats.launches.value_or(0) + LaunchesOfThread() - launches;
  if (absl::IsResourceExhausted(status)) {  // one by one they may fit
    TrimMemory(device.ordinal);
    for (const auto& member : members) alone.push_back(member->item);
    return;
  }
  stats.shared += uint32_t(members.size());
  const double wall_ms = WallMs() - wall, cpu_ms = (CpuMs() - cpu) / double(members.size());
  tbb::parallel_for(size_t{0}, members.size(), [&](size_t i) {
    BatchMember& member = *members[i];
    const BatchItem& item = *member.item;
    if (!status.ok()) return item.done(status);
    if (!pass->Finished(i)) return;
    const double prepared_ms = member.stats.stages[0].second + member.stats.stages[1].second;  // vertex_shade, plan
    member.stats.voxelize_ms = wall_ms + prepared_ms;
    member.stats.voxelize_cpu_ms = cpu_ms + prepared_ms;
    member.stats.stages.emplace_back(member.stage(), wall_ms);
    absl::StatusOr<VoxelizeResult> result = pass->Cut(i);
    item.job->Report(member.stage(), 1);
    item.done(std::move(result));
  });
  if (!status.ok()) return;
  for (size_t i = 0; i < members.size(); ++i) {
    if (pass->Finished(i)) continue;
    alone.push_back(members[i]->item);
    --stats.shared;
  }
}

}  // namespace

std::vector<size_t> RunShared(const Backend& backend, const DeviceInfo& device, std::span<const BatchItem> items,
                              const PlanLimits& limits, BatchStats& stats) {
  std::vector<size_t> alone;
  if (items.size() < 2) {
    for (size_t i = 0; i < items.size(); ++i) alone.push_back(i);
    return alone;
  }
  std::vector<std::unique_ptr<BatchMember>> members(items.size());
  tbb::parallel_for(size_t{0}, items.size(), [&](size_t i) {
    tbb::this_task_arena::isolate([&] {
      try {
        members[i] = PrepareMember(backend, items[i], limits);
      } catch (const std::bad_alloc&) {
        members[i].reset();
      }
    });
  });
  std::vector<std::unique_ptr<BatchMember>> together;
  for (size_t i = 0; i < items.size(); ++i) {
    if (members[i] == nullptr) {
      alone.push_back(i);
      continue;
    }
    if (items[i].on_plan) {
      if (absl::Status refused = items[i].on_plan(members[i]->plan); !refused.ok()) {
        items[i].done(refused);
        continue;
      }
    }
    together.push_back(std::move(members[i]));
  }
  std::stable_sort(together.begin(), together.end(),
                   [](const auto& a, const auto& b) { return a->order() < b->order(); });
  const PassSize most = MostOfPass(device);
  std::vector<const BatchItem*> left;  // run alone after all passes
  for (size_t begin = 0; begin < together.size();) {
    PassSize size;
    size_t end = begin;
    for (; end < together.size(); ++end) {
      size.Add(*together[end]);
      if (end > begin && !size.FitsInto(most)) break;
    }
    RunPass(device, std::span(together).subspan(begin, end - begin), stats, left);
    begin = end;
  }
  for (const BatchItem* item : left) alone.push_back(size_t(item - items.data()));
  return alone;
}

}  // namespace voxelpipe::cuda
