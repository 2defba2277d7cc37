// How many bytes of meshes went to each device: what keeping them there saves.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

// All of it since the process began, kept on the device or not. Thread-safe.
void CountMeshUpload(int ordinal, uint64_t bytes);
uint64_t MeshUploadedBytes(int ordinal);

}  // namespace voxelpipe::cuda
