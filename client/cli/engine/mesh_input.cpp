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

}  // namespace voxelpipe::cli
