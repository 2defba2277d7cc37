// The registry of backends of this build and machine. It is defined above the backends, in core/backends.cpp.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "job/request.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// Every device of this machine that was found, best first: GPUs, then the CPU. They live as long as the process.
std::vector<const Backend*> Devices();

// Most bytes of meshes with a content id (mesh/triangle_mesh.h) that each GPU keeps between runs; by default a quarter
// of its memory.
void SetDeviceMeshBytes(uint64_t bytes);

// Adds a device that the caller made, before those that were found. Before the first use of anything here; `device`
// must live as long as the process.
void RegisterDevice(const Backend* device);

// The backend for a choice; `auto` takes the best that is there. FAILED_PRECONDITION naming the backend that is
// missing. The object lives as long as the process.
absl::StatusOr<const Backend*> SelectBackend(BackendChoice choice);

}  // namespace voxelpipe
