// A Voxelize call that runs while the test does something else.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <future>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "client.h"
#include "gtest/gtest.h"
#include "service/support/server_process.h"

namespace voxelpipe::testing {

// Cancelled at the latest by the destructor. `client` must outlive it.
class BackgroundCall {
 public:
  BackgroundCall(Client& client, std::vector<uint8_t> mesh_bytes, VoxelizeRequest request)
      : job_([this](std::string_view stage, double) { Note(std::string(stage)); }),
        mesh_bytes_(std::move(mesh_bytes)),
        request_(std::move(request)),
        result_(std::async(std::launch::async, [this, &client] {
          return client.Voxelize(mesh_bytes_, MeshFormat::kGlb, request_, job_,
                                 [this](const Plan&) { Note(kPlanned); });
        })) {}
  ~BackgroundCall() { Cancel(); }  // the future waits for the thread

  void Cancel() { job_.Cancel(); }

  // True once the server has planned the job: a worker runs it.
  bool WaitUntilPlanned() { return WaitFor(kPlanned); }
  // True once this stage was reported. Also false when the call ends without it.
  bool WaitFor(const std::string& stage) {
    const auto deadline = std::chrono::steady_clock::now() + kPatience;
    std::unique_lock lock(mutex_);
    while (!Seen(stage)) {
      if (std::chrono::steady_clock::now() > deadline || IsOver()) return Seen(stage);
      changed_.wait_for(lock, std::chrono::milliseconds(10));
    }
    return true;
  }
  bool IsOver() { return result_.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }

  // The end of the call, at most kPatience away.
  absl::StatusOr<RemoteResult> Result() {
    if (result_.wait_for(kPatience) != std::future_status::ready) {
      ADD_FAILURE() << "the call does not end";
      Cancel();
    }
    return result_.get();
  }

 private:
  static constexpr char kPlanned[] = "planned";

  void Note(std::string stage) {
    const std::lock_guard lock(mutex_);
    stages_.push_back(std::move(stage));
    changed_.notify_all();
  }
  bool Seen(const std::string& stage) const {
    return std::find(stages_.begin(), stages_.end(), stage) != stages_.end();
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> stages_;
  JobContext job_;
  const std::vector<uint8_t> mesh_bytes_;
  const VoxelizeRequest request_;
  std::future<absl::StatusOr<RemoteResult>> result_;  // last member: its thread uses all of the above
};

}  // namespace voxelpipe::testing
