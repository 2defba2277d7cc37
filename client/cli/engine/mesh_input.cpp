#include <filesystem>
#include <utility>

#include "engine/clock.h"
#include "engine/engine.h"
#include "load/local_file.h"
#include "options/standard_streams.h"

namespace voxelpipe::cli {
namespace {

absl::StatusOr<FileBytes> ReadAndPack(const std::string& path, const OutsideFiles& outside, MeshFileType& type,
                                      WarningList& warnings, const JobContext& job) {
  // Not ReadAndPackMeshFile, whose errors begin with the path: every message about an input does already.
  const uint64_t limit = LoadLimits().max_file_bytes;
  absl::StatusOr<FileBytes> bytes = IsStandardStream(path) ? ReadStandardInput(limit, job) : ReadLocalFile(path, limit);
  if (!bytes.ok()) return bytes.status();
  const std::filesystem::path directory =
      IsStandardStream(path) ? std::filesystem::path() : std::filesystem::path(path).parent_path();
  if (type.format == MeshFormat::kAuto) {
    const absl::StatusOr<MeshFormat> format = FormatToTell(job, *bytes, path);
    if (!format.ok()) return format.status();
    type.format = *format;
  }
  return PackMesh(job, *std::move(bytes), directory, {}, &warnings, outside, type.format);
}

}  // namespace

absl::StatusOr<MeshInput> ReadMeshInput(const std::string& path, const MeshReading& reading, const JobContext& job) {
  const Stopwatch read;
  job.Report("load", 0);
  WarningList warnings;
  MeshFileType type = reading.type;
  absl::StatusOr<FileBytes> bytes = ReadAndPack(path, reading.outside, type, warnings, job);
  if (!bytes.ok()) return bytes.status();
  return MeshInput{*std::move(bytes), read.Milliseconds(), std::move(warnings), type};
}

absl::StatusOr<LoadedMesh> LoadMeshInput(MeshInput mesh, const TextureUse& use, const JobContext& job) {
  absl::StatusOr<LoadedMesh> loaded =
      LoadMeshFor(job, mesh.bytes, {.type = mesh.type, .textures = use}, [&mesh] { mesh.bytes = FileBytes(); });
  if (loaded.ok()) loaded->load_ms += mesh.read_ms;
  return loaded;
}

}  // namespace voxelpipe::cli
