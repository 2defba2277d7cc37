#include <utility>

#include "engine/clock.h"
#include "engine/engine.h"
#include "options/standard_streams.h"

namespace voxelpipe::cli {
namespace {

absl::StatusOr<FileBytes> ReadAndPack(const std::string& path, const OutsideFiles& outside, WarningList& warnings,
                                      const JobContext& job) {
  if (!IsStandardStream(path)) return ReadAndPackMeshFile(path, {}, &warnings, outside);
  absl::StatusOr<FileBytes> bytes = ReadStandardInput(LoadLimits().max_file_bytes, job);
  if (!bytes.ok()) return bytes.status();
  return PackMesh(*std::move(bytes), "", {}, &warnings, outside);
}

}  // namespace

absl::StatusOr<MeshInput> ReadMeshInput(const std::string& path, const OutsideFiles& outside, const JobContext& job) {
  const Stopwatch read;
  job.Report("load", 0);
  WarningList warnings;
  absl::StatusOr<FileBytes> bytes = ReadAndPack(path, outside, warnings, job);
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
