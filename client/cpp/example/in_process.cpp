// usage: in_process MESH
// Voxelizes a mesh file in this process and prints how many voxels its surface touches.
#include <voxelpipe/load/load_mesh.h>
#include <voxelpipe/load/pack.h>
#include <voxelpipe/pipeline/voxelize.h>

#include <iostream>

absl::Status Run(const char* path) {
  const auto file = voxelpipe::ReadAndPackMeshFile(path);
  if (!file.ok()) return file.status();
  const voxelpipe::JobContext job;  // cancel, deadline, progress
  const auto loaded = voxelpipe::LoadMeshFor(job, file->bytes, {file->format});
  if (!loaded.ok()) return loaded.status();
  voxelpipe::VoxelizeRequest request;
  request.grid.resolution = 64;
  const auto result = voxelpipe::Voxelize(loaded->mesh, request, {.job = job});
  if (!result.ok()) return result.status();
  const auto& dims = result->grid.dims;
  std::cout << dims[0] << "x" << dims[1] << "x" << dims[2] << ": " << result->stats.occupied << " voxels\n";
  return absl::OkStatus();
}

int main(int argc, char** argv) {
  const absl::Status status = argc == 2 ? Run(argv[1]) : absl::InvalidArgumentError("usage: in_process MESH");
  if (!status.ok()) std::cerr << status.message() << "\n";
  return status.ok() ? 0 : 1;
}
