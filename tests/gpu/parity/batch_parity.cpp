#include "gpu/parity/batch_parity.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <optional>

#include "absl/strings/str_cat.h"
#include "gpu/cases/batch_cases.h"
#include "gpu/parity/first_difference.h"
#include "pipeline/stages/backend.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

class Copy final : public ResultSink {
 public:
  explicit Copy(Delivered& to) : to_(to) {}
  absl::Status Begin(const ResultHeader& header) override {
    to_.header = header;
    to_.arrays.resize(header.arrays.size());
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    to_.arrays.at(array).insert(to_.arrays[array].end(), bytes.begin(), bytes.end());
    return absl::OkStatus();
  }

 private:
  Delivered& to_;
};

Delivered Deliver(VoxelizeResult& result) {
  Delivered delivered;
  Copy copy(delivered);
  (void)WriteTo(result, copy);  // it refuses nothing
  delivered.stats = std::move(result.stats);
  return delivered;
}

bool IsPlain(const VoxelizeRequest& request) {
  return request.result != ResultKind::kBuckets &&
         std::all_of(request.targets.begin(), request.targets.end(),
                     [](const TargetSpec& t) { return t.format == VoxelFormat::kBit && t.shader.name == "occupancy"; });
}

// True if its A-buffer shares a pass: it is so small that any triangles have few fragments.
bool IsSmallABuffer(const TriangleMesh& mesh, const VoxelizeResult& result) {
  return result.kind == ResultKind::kBuckets && mesh.triangles.size() * result.grid.voxels() <= 1 << 24;
}

// Those with cavities, those that are open, those that fill a grid's border, with attributes, and with hardly anything.
bool IsForFloods(const ParityMesh& named) {
  constexpr const char* kNames[] = {"attributed400", "nested",         "open_half_sphere",
                                    "octahedron",    "lattice_sheets", "triangle"};
  return std::any_of(std::begin(kNames), std::end(kNames), [&](const char* name) { return named.name == name; });
}

struct Result {
  std::optional<absl::StatusOr<VoxelizeResult>> result;
  bool shared = false;  // it came while shared passes ran

  bool ok() const { return result && result->ok(); }
  std::string Outcome() const {
    if (!result) return "nothing";
    return result->ok() ? "a result" : std::string(result->status().ToString());
  }
};

}  // namespace

void BatchParity::Add(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh,
                      const std::vector<ParityCase>& cases, size_t every) {
  for (size_t i = 0; i < cases.size(); ++i) {
    if (!IsPlain(cases[i].request) && i % every != 0) continue;
    Add(absl::StrCat(name, "#", i, " ", Describe(cases[i])), mesh, cases[i].request);
  }
}

void BatchParity::AddABuffers(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh) {
  for (const ParityCase& c : FragmentCases()) Add(absl::StrCat(name, " batch ", Describe(c)), mesh, c.request);
}

void BatchParity::AddFloods(const std::string& name, const std::shared_ptr<const TriangleMesh>& mesh, size_t first) {
  const std::vector<ParityCase> cases = FloodCases();
  for (size_t i = first; i < cases.size(); i += 2) {
    Add(absl::StrCat(name, " batch ", Describe(cases[i])), mesh, cases[i].request, true);
  }
}

void BatchParity::Add(std::string line, std::shared_ptr<const TriangleMesh> mesh, const VoxelizeRequest& request,
                      std::optional<bool> shares) {
  waiting_.push_back({std::move(line), std::move(mesh), request, shares});
  if (waiting_.size() >= most_) Flush();
}

void BatchParity::Differ(const std::string& line, const std::string& how) {
  ++differ_;
  if (differ_ <= 20) std::printf("BATCH DIFFERS %s\n        %s\n", line.c_str(), how.c_str());
}

void BatchParity::Flush() {
  if (waiting_.empty()) return;
  const JobContext job;
  std::vector<Result> expected(waiting_.size());
  const auto run = [&](const Backend& backend, BackendChoice choice, std::vector<Result>& results) {
    BatchStats stats;
    std::vector<BatchItem> items;
    for (size_t i = 0; i < waiting_.size(); ++i) {
      waiting_[i].request.backend = choice;
      items.push_back(
          {waiting_[i].mesh.get(), &waiting_[i].request, &job, {}, [&, i](absl::StatusOr<VoxelizeResult> result) {
             results[i].result = std::move(result);
             results[i].shared = stats.sharing;
           }});
    }
    VoxelizeBatch(backend, items, 0, {}, stats);
    return stats;
  };
  run(*Devices().back(), BackendChoice::kCpu, expected);
  const auto choice = device_.name() == "cuda" ? BackendChoice::kCuda : BackendChoice::kCpu;
  for (int round = 0; round < 2; ++round) {
    std::vector<Result> got(waiting_.size());
    const BatchStats stats = run(device_, choice, got);
    ++batches_;
    shared_ += stats.shared;
    passes_ += stats.passes;
    launches_ += stats.launches.value_or(0);
    for (size_t i = 0; i < waiting_.size(); ++i) {
      ++cases_;
      std::optional<std::string> difference;
      if (!expected[i].ok() || !got[i].ok()) {
        if (expected[i].Outcome() != got[i].Outcome()) {
          difference = absl::StrCat(expected[i].Outcome(), " and ", got[i].Outcome());
        }
      } else if (VoxelizeResult& here = **got[i].result; here.stats.backend != device_.name()) {
        difference = "ran on " + here.stats.backend;
      } else {
        VoxelizeResult& there = **expected[i].result;
        a_buffers_ += here.kind == ResultKind::kBuckets;
        shared_a_buffers_ += here.kind == ResultKind::kBuckets && got[i].shared;
        floods_ += waiting_[i].request.fill == Fill::kFlood;
        shared_floods_ += waiting_[i].request.fill == Fill::kFlood && got[i].shared;
        std::optional<bool> shares = waiting_[i].shares;
        if (IsSmallABuffer(*waiting_[i].mesh, here)) shares = true;
        if (Shares() && shares.value_or(got[i].shared) != got[i].shared) {
          difference = *shares ? "it shared no pass" : "it shared a pass";
        }
        Delivered copy = Deliver(here);
        VoxelizeStats stats_of_cpu = there.stats;
        if (!difference) difference = FirstDifference(Deliver(there), copy);
        there.stats = std::move(stats_of_cpu);  // Deliver took them
      }
      if (difference) Differ(waiting_[i].line, *difference);
    }
  }
  waiting_.clear();
}

void BatchParity::Finish() {
  auto vertices_alone = std::make_shared<TriangleMesh>(testing::Cube(16));
  vertices_alone->triangles.clear();
  AddABuffers("no_triangles", vertices_alone);
  AddABuffers("nothing", std::make_shared<const TriangleMesh>());
  AddABuffers("cube", std::make_shared<const TriangleMesh>(testing::Cube(16)));
  AddFloods("no_triangles", vertices_alone, 0);
  AddFloods("nothing", std::make_shared<const TriangleMesh>(), 1);
  size_t first = 0;
  for (const ParityMesh& named : ParityMeshes(1)) {
    if (IsForFloods(named)) AddFloods(named.name, std::make_shared<const TriangleMesh>(named.make()), first++ % 2);
  }
  for (const int levels : {2, 10}) {
    const auto labyrinth = std::make_shared<const TriangleMesh>(Labyrinth(levels));
    for (const bool shaded : {false, true}) {
      // The long one takes more sweeps than a pass waits for.
      Add(absl::StrCat("labyrinth of ", levels, shaded ? " shaded" : ""), labyrinth, FloodOfLabyrinth(shaded),
          levels == 2);
    }
  }
  Flush();
  if (Shares()) CheckLaunches();
}

void BatchParity::CheckLaunches() {
  std::vector<TriangleMesh> meshes;
  for (uint32_t seed = 1; seed <= 48; ++seed) meshes.push_back(testing::Soup(10 + int(seed), 8, seed));
  const JobContext job;
  VoxelizeRequest flood = FloodOfLabyrinth(/*shaded=*/true);
  flood.grid = FittedABuffer(8, false).grid;
  for (VoxelizeRequest request : {FittedABuffer(8, false), FittedABuffer(8, true), flood}) {
    request.backend = BackendChoice::kCuda;
    std::optional<uint64_t> launches_of_few;
    for (const size_t count : {size_t{6}, meshes.size()}) {
      std::vector<BatchItem> items;
      for (size_t i = 0; i < count; ++i) items.push_back({&meshes[i], &request, &job, {}, [](const auto&) {}});
      const BatchStats stats = VoxelizeBatch(device_, items, 0);
      const char* const what = request.fill == Fill::kFlood                     ? " flood fills of soups"
                               : request.targets[0].format == VoxelFormat::kBit ? " A-buffers of soups"
                                                                                : " shaded A-buffers of soups";
      const std::string line = absl::StrCat(count, what);
      if (stats.shared != count) Differ(line, absl::StrCat(stats.shared, " shared a pass"));
      if (stats.passes != 1 && !IsShort()) Differ(line, absl::StrCat(stats.passes, " passes"));
      const uint64_t launches = stats.launches.value_or(0) / stats.passes;
      if (launches_of_few.value_or(launches) != launches) {
        Differ(line, absl::StrCat(launches, " launches, and few take ", *launches_of_few));
      }
      launches_of_few = launches;
    }
  }
}

void BatchParity::Report() const {
  std::printf(
      "batches: %llu of %llu items, %llu of them shared a pass; %llu passes, %llu launches of the shared; %llu of %llu "
      "A-buffers and %llu of %llu flood fills shared; %llu differ\n",
      static_cast<unsigned long long>(batches_), static_cast<unsigned long long>(cases_),
      static_cast<unsigned long long>(shared_), static_cast<unsigned long long>(passes_),
      static_cast<unsigned long long>(launches_), static_cast<unsigned long long>(shared_a_buffers_),
      static_cast<unsigned long long>(a_buffers_), static_cast<unsigned long long>(shared_floods_),
      static_cast<unsigned long long>(floods_), static_cast<unsigned long long>(differ_));
}

}  // namespace voxelpipe::gpu
