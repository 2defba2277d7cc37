#include "cuda/run_state.h"

namespace voxelpipe::cuda {

absl::Status SolidFill(RunState&) {
  return absl::UnimplementedError("fills on CUDA");
}

}  // namespace voxelpipe::cuda
