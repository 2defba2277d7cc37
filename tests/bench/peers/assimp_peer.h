// assimp's loader, for comparison.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace voxelpipe::bench {

struct PeerLoad {
  double wall_ms = 0;
  uint64_t triangles = 0;
};

// The time that assimp's aiImportFileFromMemory takes for a file's bytes, with transforms applied as our flattening
// does. `format`: the extension of its name. Empty if the benchmarks were built without assimp, or it cannot read them.
std::optional<PeerLoad> LoadWithAssimp(std::span<const uint8_t> file, const char* format);

}  // namespace voxelpipe::bench
