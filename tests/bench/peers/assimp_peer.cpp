#include "bench/peers/assimp_peer.h"

#ifdef VOXELPIPE_ASSIMP
#include <assimp/cimport.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include "base/wall_clock.h"

namespace voxelpipe::bench {

std::optional<PeerLoad> LoadWithAssimp(std::span<const uint8_t> file, const char* format) {
  const double begin = WallMs();
  const aiScene* const scene = aiImportFileFromMemory(reinterpret_cast<const char*>(file.data()), unsigned(file.size()),
                                                      aiProcess_PreTransformVertices, format);
  PeerLoad load{WallMs() - begin, 0};
  if (scene == nullptr) return std::nullopt;
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) load.triangles += scene->mMeshes[i]->mNumFaces;
  aiReleaseImport(scene);
  return load;
}

}  // namespace voxelpipe::bench
#else
namespace voxelpipe::bench {

std::optional<PeerLoad> LoadWithAssimp(std::span<const uint8_t> /*file*/, const char* /*format*/) {
  return std::nullopt;
}

}  // namespace voxelpipe::bench
#endif
