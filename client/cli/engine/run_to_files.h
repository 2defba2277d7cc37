// The meshes of one run, from their bytes to the files of the result.
#pragma once

#include <cstdint>
#include <functional>

#include "absl/status/statusor.h"
#include "engine/engine.h"
#include "engine/report.h"
#include "options/output_plan.h"

namespace voxelpipe::cli {

// Called with the number of voxels as soon as the grid is known.
using OnGrid = std::function<void(uint64_t voxels)>;

// Runs the request and writes the files of `plan`, each file under a temporary name and then renamed; directories are
// created. Out: the run, and all of `report` except its input. Arrays are written while they are made; only a picture
// needs the whole result in memory. Errors: those of Engine::Run, and the system's with the path.
absl::StatusOr<EngineRun> RunToFiles(Engine& engine, MeshInputs meshes, const VoxelizeRequest& request, int repeat,
                                     const OutputPlan& plan, JobContext& job, VoxelizeReport& report,
                                     const OnGrid& on_grid = {});

}  // namespace voxelpipe::cli
