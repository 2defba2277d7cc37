// Copies finished dense slabs to the host while the next slab is processed.
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

// The bytes of a target on the device.
struct DenseSource {
  const void* from;
  uint64_t bytes;
};

// Converts the targets of the state's dense slab to their result format. Temporary arrays are added to `packed`.
absl::Status PackDense(RunState& state, std::vector<DeviceArray<uint32_t>>& packed, std::vector<DenseSource>& sources);
// Queues their copies, to pinned memory if available. The buffers are in use until the stream's work is done, even
// after an error.
absl::Status CopyDense(const std::vector<DenseSource>& sources, cudaStream_t stream, ResultArrays& out);

// Copies the targets of the state's dense slab to memory of their own on the device (ResultArrays::device_targets).
// Synchronizes.
absl::StatusOr<ResultArrays> KeepDense(RunState& state);

// Double buffering: copies run on a separate stream from one of two sets of the slab's arrays, while the stages fill
// the other. They overlap only if the host memory is pinned. For one run; not thread-safe. The destructor waits for the
// copies.
class SlabCopies {
 public:
  static absl::StatusOr<SlabCopies> Make(int ordinal);
  SlabCopies(SlabCopies&&) = default;
  ~SlabCopies() { Wait(); }

  // Starts the copy of the finished slab, and gives the state the other set of arrays.
  absl::StatusOr<SlabArrays> Start(RunState& state);
  // Waits for the copies and releases the other set's memory, in the order of the state's stream.
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
    std::shared_ptr<Event> copied;  // null: no copy in progress
  };

  explicit SlabCopies(DeviceUse use) : use_(std::make_unique<DeviceUse>(std::move(use))) {}
  static absl::StatusOr<std::shared_ptr<Event>> Record(cudaStream_t stream);
  void Wait() const {
    if (use_ != nullptr) use_->Wait();
  }

  std::unique_ptr<DeviceUse> use_;  // with the copy stream
  Set other_;
};

}  // namespace voxelpipe::cuda
