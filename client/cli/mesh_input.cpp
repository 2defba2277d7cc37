#include <utility>

#include "clock.h"
#include "engine.h"
#include "load/pack.h"

namespace voxelpipe::cli {

absl::StatusOr<MeshInput> ReadMeshInput(const std::string& path, const JobContext& job) {
  const Stopwatch read;
  job.Report("load", 0);
  WarningList warnings;
  absl::StatusOr<FileBytes> bytes = ReadAndPackMeshFile(path, {}, &warnings);
  if (!bytes.ok()) return bytes.status();
  return MeshInput{*std::move(bytes), read.Milliseconds(), std::move(warnings)};
}

}  // namespace voxelpipe::cli
