// Bytes of meshes uploaded to each device, a measure of what the mesh cache saves.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

// Total since the process started, whether cached or not. Thread-safe.
void CountMeshUpload(int ordinal, uint64_t bytes);
uint64_t MeshUploadedBytes(int ordinal);

}  // namespace voxelpipe::cuda
