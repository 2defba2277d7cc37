// Vertex codec version 1 of KHR_meshopt_compression.
#pragma once

#include <cstdint>
#include <span>

namespace voxelpipe {

// The version of a compressed vertex buffer: 0 or 1; -1 for other bytes. Never reads past the end.
int MeshoptVertexVersion(std::span<const uint8_t> compressed);

// In: a stream of version 1 (header byte 0xa1) of out.size() / stride vertices; the stride is a multiple of 4 up to 256
// and divides out.size(). Out: the vertices. False for a stream that is broken or of another size; `out` is then
// undefined.
bool DecodeMeshoptVertexV1(std::span<const uint8_t> compressed, uint64_t stride, std::span<uint8_t> out);

}  // namespace voxelpipe
