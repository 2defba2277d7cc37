// usage: by_server MESH HOST:PORT
// Stores a mesh on a server, voxelizes it there and prints how many voxels its surface touches.
#include <voxelpipe/client.h>
#include <voxelpipe/load/pack.h>

#include <chrono>
#include <iostream>

absl::Status Run(const char* path, const char* target) {
  const auto file = voxelpipe::ReadAndPackMeshFile(path);
  if (!file.ok()) return file.status();
  const auto client = voxelpipe::Client::Connect(target);
  if (!client.ok()) return client.status();
  voxelpipe::JobContext job;
  job.set_deadline(voxelpipe::JobContext::Clock::now() + std::chrono::seconds(60));
  const auto stored = (*client)->UploadMesh(file->bytes, file->format, job);  // its bytes travel once
  if (!stored.ok()) return stored.status();
  voxelpipe::VoxelizeRequest request;
  request.grid.resolution = 64;
  const auto remote = (*client)->VoxelizeStored(stored->name, request, job);
  if (!remote.ok()) return remote.status();
  const auto& dims = remote->result.grid.dims;
  std::cout << dims[0] << "x" << dims[1] << "x" << dims[2] << ": " << remote->stats.occupied << " voxels\n";
  return absl::OkStatus();
}

int main(int argc, char** argv) {
  const absl::Status status =
      argc == 3 ? Run(argv[1], argv[2]) : absl::InvalidArgumentError("usage: by_server MESH HOST:PORT");
  if (!status.ok()) std::cerr << status.message() << "\n";
  return status.ok() ? 0 : 1;
}
