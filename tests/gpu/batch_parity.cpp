#include "gpu/batch_parity.h"

#include <algorithm>
#include <cstdio>
#include <optional>

#include "absl/strings/str_cat.h"
#include "gpu/first_difference.h"
#include "pipeline/backend.h"

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
  return request.result != ResultKind::kBuckets && request.fill != Fill::kFlood &&
         std::all_of(request.targets.begin(), request.targets.end(),
                     [](const TargetSpec& t) { return t.format == VoxelFormat::kBit && t.shader.name == "occupancy"; });
}

using Result = std::optional<absl::StatusOr<VoxelizeResult>>;

std::string Outcome(const Result& result) {
  if (!result) return "nothing";
  return result->ok() ? "a result" : std::string(result->status().ToString());
}

}  // namespace

void BatchParity::Add(const std::string& name, std::shared_ptr<const TriangleMesh> mesh,
                      const std::vector<ParityCase>& cases, size_t every) {
  for (size_t i = 0; i < cases.size(); ++i) {
    if (!IsPlain(cases[i].request) && i % every != 0) continue;
    waiting_.push_back({absl::StrCat(name, "#", i, " ", Describe(cases[i])), mesh, cases[i].request});
    if (waiting_.size() >= most_) Flush();
  }
}

void BatchParity::Flush() {
  if (waiting_.empty()) return;
  const JobContext job;
  std::vector<Result> expected(waiting_.size());
  const auto run = [&](const Backend& backend, BackendChoice choice, std::vector<Result>& results) {
    std::vector<BatchItem> items;
    for (size_t i = 0; i < waiting_.size(); ++i) {
      waiting_[i].request.backend = choice;
      items.push_back({waiting_[i].mesh.get(),
                       &waiting_[i].request,
                       &job,
                       {},
                       [&results, i](absl::StatusOr<VoxelizeResult> result) { results[i] = std::move(result); }});
    }
    return VoxelizeBatch(backend, items, 0);
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
      if (!expected[i] || !expected[i]->ok() || !got[i] || !got[i]->ok()) {
        if (Outcome(expected[i]) != Outcome(got[i])) {
          difference = absl::StrCat(Outcome(expected[i]), " and ", Outcome(got[i]));
        }
      } else if ((*got[i])->stats.backend != device_.name()) {
        difference = "ran on " + (*got[i])->stats.backend;
      } else {
        Delivered copy = Deliver(**got[i]);
        VoxelizeStats stats_of_cpu = (*expected[i])->stats;
        difference = FirstDifference(Deliver(**expected[i]), copy);
        (*expected[i])->stats = std::move(stats_of_cpu);  // Deliver took them
      }
      if (!difference) continue;
      ++differ_;
      if (differ_ <= 20) std::printf("BATCH DIFFERS %s\n        %s\n", waiting_[i].line.c_str(), difference->c_str());
    }
  }
  waiting_.clear();
}

void BatchParity::Report() const {
  std::printf(
      "batches: %llu of %llu items, %llu of them shared a pass; %llu passes, %llu launches of the shared; %llu "
      "differ\n",
      static_cast<unsigned long long>(batches_), static_cast<unsigned long long>(cases_),
      static_cast<unsigned long long>(shared_), static_cast<unsigned long long>(passes_),
      static_cast<unsigned long long>(launches_), static_cast<unsigned long long>(differ_));
}

}  // namespace voxelpipe::gpu
