#include "calls/job_setup.h"

#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32c.h"
#include "calls/call_setup.h"
#include "jobs/request_memory.h"
#include "wire/mesh_name.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

absl::Status FindKeptMeshes(ServiceState& state, VoxelizeJob& job) {
  job.store = &state.meshes;
  if (job.config.placed) {
    absl::StatusOr<std::vector<std::shared_ptr<KeptMesh>>> meshes = state.meshes.TakeAll(*job.config.placed);
    if (meshes.ok()) job.kept = *std::move(meshes);
    return meshes.status();
  }
  if (job.config.mesh_name.empty()) return absl::OkStatus();
  if (absl::Status s = CheckMeshName(job.config.mesh_name, "mesh.stored.name"); !s.ok()) return s;
  absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state.meshes.Take(job.config.mesh_name);
  if (mesh.ok()) job.kept = {*std::move(mesh)};
  return mesh.status();
}

}  // namespace

absl::Status ConfigureJob(ServiceState& state, const v1::VoxelizeRequest& message, const std::string& client,
                          VoxelizeJob& job) {
  absl::StatusOr<ParsedConfig> parsed = ParseRequest(message);
  if (!parsed.ok()) return parsed.status();
  job.config = *std::move(parsed);
  const CallSettings& settings = job.config.settings;
  job.limits = &state.limits;
  job.memory = MakeRequestMemory(state.working, job.context);
  job.traits.client = client;
  job.traits.deadline = job.context.deadline();
  const BackendChoice asked = job.config.request.backend;
  if (absl::Status s = PrepareRequest(state, job.config.request); !s.ok()) return s;
  ChooseKinds(state, asked, job.config, job.traits);
  if (absl::Status s = state.pool.CheckServed(job.traits); !s.ok()) return s;
  job.traits.priority = settings.priority;
  job.traits.queue_timeout = settings.queue_timeout;
  if (absl::Status s = FindKeptMeshes(state, job); !s.ok()) return s;
  job.Weigh();
  return absl::OkStatus();
}

MeshData MeshDataOf(v1::VoxelizeRequest& request) {
  MeshData data;
  v1::MeshSource& source = *request.mutable_mesh();
  const auto take = [&data](auto& message) {
    data.bytes = message.mutable_data();
    if (message.has_crc32c()) data.crc32c = message.crc32c();
  };
  if (source.has_bytes()) {
    take(*source.mutable_bytes());
  } else if (source.stored().has_positions()) {
    take(*source.mutable_stored()->mutable_positions());
  }
  return data;
}

absl::Status CheckMeshCrc(std::string_view bytes, std::optional<uint32_t> crc32c, uint64_t offset) {
  if (!crc32c || Crc32c({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}) == *crc32c) {
    return absl::OkStatus();
  }
  return absl::DataLossError(absl::StrCat("the CRC-32C of the mesh bytes from offset ", offset, " does not fit"));
}

PieceOptions PiecesOf(const ServerOptions& options) {
  return {.piece_bytes = options.piece_bytes, .zstd_level = options.zstd_level};
}

}  // namespace voxelpipe
