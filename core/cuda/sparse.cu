#include "cuda/run_state.h"

namespace voxelpipe::cuda {

absl::Status MakeBricks(RunState&) {
  return absl::UnimplementedError("MakeBricks on CUDA");
}

}  // namespace voxelpipe::cuda
