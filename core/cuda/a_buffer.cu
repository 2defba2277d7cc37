#include "cuda/run_state.h"

namespace voxelpipe::cuda {

absl::Status EmitFragments(RunState&) {
  return absl::UnimplementedError("EmitFragments on CUDA");
}

absl::Status SortFragments(RunState&) {
  return absl::UnimplementedError("SortFragments on CUDA");
}

absl::Status Resolve(RunState&) {
  return absl::UnimplementedError("Resolve on CUDA");
}

}  // namespace voxelpipe::cuda
