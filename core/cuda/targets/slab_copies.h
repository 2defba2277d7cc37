// Dense slabs on their way to the host while the next one is worked on.
#pragma once

#include <array>
#include <memory>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "cuda/device/device.h"
#include "cuda/run/run_state.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe::cuda {

// A target's bytes on the device.
struct DenseSource {
  const void* from;
  uint64_t bytes;
};

// The targets of the state's dense slab in their result format. What they read besides the state's own arrays is added
// to `packed`.
absl::Status PackDense(RunState& state, std::vector<DeviceArray<uint32_t>>& packed, std::vector<DenseSource>& sources);
// Starts their copies, into pinned memory where there is some. The buffers take part in the stream's work until that is
// done, also where this fails.
absl::Status CopyDense(const std::vector<DenseSource>& sources, cudaStream_t stream, ResultArrays& out);

// Copies go on a stream of their own, from one of two sets of the slab's arrays, while the stages fill the other. They
// overlap where the host's memory is pinned. Of one run; not thread-safe. At its end it waits for the copies.
class SlabCopies {
 public:
  static absl::StatusOr<SlabCopies> Make(int ordinal);
  SlabCopies(SlabCopies&&) = default;
  ~SlabCopies() { Wait(); }

  // Starts the copy of the slab that the state has finished, and gives the state the other set of arrays.
  absl::StatusOr<SlabArrays> Start(RunState& state);
  // Waits for the copies and gives the other set's memory back, in the order of the state's stream.
  void Forget();

 private:
  struct Event {
    Event() = default;
    Event(const Event&) = delete;
    Event& operator=(const Event&) = delete;
    ~Event() {
      if (event != nullptr) (void)cudaEventDestroy(event);
    }
    cudaEvent_t event = nullptr;
  };
  struct Set {
    std::array<TargetMemory, kMaxTargets> targets;
    DeviceArray<uint32_t> coverage;
    std::vector<DeviceArray<uint32_t>> packed;
    std::shared_ptr<Event> copied;  // null: nothing is being copied
  };

  explicit SlabCopies(DeviceUse use) : use_(std::make_unique<DeviceUse>(std::move(use))) {}
  static absl::StatusOr<std::shared_ptr<Event>> Record(cudaStream_t stream);
  void Wait() const {
    if (use_ != nullptr) use_->Wait();
  }

  std::unique_ptr<DeviceUse> use_;  // of the stream that copies
  Set other_;
};

}  // namespace voxelpipe::cuda
