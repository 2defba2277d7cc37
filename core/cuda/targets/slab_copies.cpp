// Starts and awaits copies of dense slabs, and exchanges the two sets of slab arrays.
#include "cuda/targets/slab_copies.h"

namespace voxelpipe::cuda {

absl::StatusOr<SlabCopies> SlabCopies::Make(int ordinal) {
  absl::StatusOr<DeviceUse> use = DeviceUse::Begin(ordinal);
  if (!use.ok()) return use.status();
  return SlabCopies(*std::move(use));
}

absl::StatusOr<std::shared_ptr<SlabCopies::Event>> SlabCopies::Record(cudaStream_t stream) {
  auto made = std::make_shared<Event>();
  VOXELPIPE_CUDA_OR_RETURN(cudaEventCreateWithFlags(&made->event, cudaEventDisableTiming));
  VOXELPIPE_CUDA_OR_RETURN(cudaEventRecord(made->event, stream));
  return made;
}

absl::StatusOr<SlabArrays> SlabCopies::Start(RunState& state) {
  Set now;
  std::vector<DenseSource> sources;
  VOXELPIPE_OK_OR_RETURN(PackDense(state, now.packed, sources));
  const absl::StatusOr<std::shared_ptr<Event>> made = Record(state.stream);
  if (!made.ok()) return made.status();
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamWaitEvent(use_->stream(), (*made)->event, 0));
  ResultArrays out;
  absl::Status started = CopyDense(sources, use_->stream(), out);
  absl::StatusOr<std::shared_ptr<Event>> copied = Record(use_->stream());
  if (started.ok()) started = copied.status();
  if (!started.ok()) {
    Wait();  // before buffers and arrays are released
    return started;
  }
  now.copied = *std::move(copied);
  now.targets = std::move(state.target_memory);
  now.coverage = std::move(state.coverage);
  // The stages may use the other set when its copy is done.
  if (other_.copied != nullptr) VOXELPIPE_CUDA_OR_RETURN(cudaStreamWaitEvent(state.stream, other_.copied->event, 0));
  state.target_memory = std::move(other_.targets);
  state.coverage = std::move(other_.coverage);
  other_ = std::move(now);
  return SlabArrays(std::move(out), [copied_now = other_.copied]() -> absl::Status {
    VOXELPIPE_CUDA_OR_RETURN(cudaEventSynchronize(copied_now->event));
    return absl::OkStatus();
  });
}

void SlabCopies::Forget() {
  Wait();
  other_ = Set();
}

}  // namespace voxelpipe::cuda
