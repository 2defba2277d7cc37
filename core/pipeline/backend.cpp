#include "pipeline/backend.h"

#include "absl/strings/str_cat.h"
#include "cpu/backend.h"

namespace voxelpipe {

std::vector<std::string> AvailableBackends() {
  return {std::string(cpu::CpuBackend().name())};
}

absl::StatusOr<const Backend*> SelectBackend(BackendChoice choice) {
  if (choice == BackendChoice::kCuda) {
    return absl::FailedPreconditionError("backend: this build has no CUDA backend");
  }
  return &cpu::CpuBackend();
}

}  // namespace voxelpipe
