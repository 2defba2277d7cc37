// Starts and awaits copies of dense slabs, and exchanges the two sets of slab arrays.
#include "cuda/targets/slab_copies.h"

namespace voxelpipe::cuda {
namespace {

// An array that outlives its run, with a stream that orders its release.
struct KeptArray {
  DeviceUse use;  // destroyed last
  DeviceArray<uint32_t> array;
};

}  // namespace

absl::StatusOr<ResultArrays> KeepDense(RunState& state) {
  std::vector<DeviceArray<uint32_t>> packed;
  std::vector<DenseSource> sources;
  VOXELPIPE_OK_OR_RETURN(PackDense(state, packed, sources));
  ResultArrays out;
  for (const DenseSource& source : sources) {
    absl::StatusOr<DeviceUse> use = DeviceUse::Begin(state.device.ordinal);
    if (!use.ok()) return use.status();
    const auto kept = std::make_shared<KeptArray>(KeptArray{*std::move(use), {}});
    const cudaStream_t stream = kept->use.stream();
    VOXELPIPE_OK_OR_RETURN(kept->use.After(state.stream));
    VOXELPIPE_OK_OR_RETURN(kept->array.Resize((source.bytes + 3) / 4, stream));
    VOXELPIPE_CUDA_OR_RETURN(
        cudaMemcpyAsync(kept->array.data(), source.from, source.bytes, cudaMemcpyDeviceToDevice, stream));
    VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(stream));
    out.device_targets.push_back({kept, kept->array.data(), source.bytes, state.device.ordinal});
  }
  return out;
}

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
