#include <utility>

#include "engine/clock.h"
#include "engine/engine.h"

namespace voxelpipe::cli {

absl::StatusOr<MeshInput> ReadMeshInput(const std::string& path, const OutsideFiles& outside, const JobContext& job) {
  const Stopwatch read;
  job.Report("load", 0);
  WarningList warnings;
  absl::StatusOr<FileBytes> bytes = ReadAndPackMeshFile(path, {}, &warnings, outside);
  if (!bytes.ok()) return bytes.status();
  return MeshInput{*std::move(bytes), read.Milliseconds(), std::move(warnings)};
}

absl::StatusOr<LoadedMesh> LoadMeshInput(MeshInput mesh, const TextureUse& use, const JobContext& job) {
  absl::StatusOr<LoadedMesh> loaded =
      LoadMeshFor(job, mesh.bytes, {.textures = use}, [&mesh] { mesh.bytes = FileBytes(); });
  if (loaded.ok()) loaded->load_ms += mesh.read_ms;
  return loaded;
}

}  // namespace voxelpipe::cli
