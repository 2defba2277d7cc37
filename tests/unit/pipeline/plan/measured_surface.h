// What the stages of the CPU measure of a mesh for a plan.
#pragma once

#include "gtest/gtest.h"
#include "pipeline/stages/backend.h"
#include "pipeline/stages/bind.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe::testing {

// Stages::Measure on the grid that the request fits to the mesh.
inline Surface MeasuredSurface(const TriangleMesh& mesh, const VoxelizeRequest& request, bool closely) {
  const Backend& cpu = **SelectBackend(BackendChoice::kCpu);
  const BoundRequest bound = *BindRequest(JobContext(), mesh, request);
  const JobContext job;
  absl::StatusOr<Surface> surface = absl::UnknownError("not run");
  cpu.Run(request.threads, [&] {
    auto stages = cpu.Start(mesh, bound, job);
    const absl::StatusOr<MeshExtent> extent = (*stages)->VertexShade();
    const MeshSize size{mesh.triangles.size(), mesh.positions.size(), *extent};
    surface = (*stages)->Measure(*FitGrid(request.grid, extent->box), size, closely);
  });
  EXPECT_TRUE(surface.ok()) << surface.status();
  return *surface;
}

}  // namespace voxelpipe::testing
