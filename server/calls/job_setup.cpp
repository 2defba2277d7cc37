#include "calls/job_setup.h"

#include <utility>

#include "calls/call_setup.h"
#include "jobs/request_memory.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

absl::Status FindKeptMesh(ServiceState& state, VoxelizeJob& job) {
  if (job.config.mesh_id.empty()) return absl::OkStatus();
  if (absl::Status s = CheckMeshId(job.config.mesh_id, "mesh_id"); !s.ok()) return s;
  absl::StatusOr<std::shared_ptr<KeptMesh>> mesh = state.meshes.Take(job.config.mesh_id);
  if (!mesh.ok()) return mesh.status();
  job.store = &state.meshes;
  job.kept = *std::move(mesh);
  return absl::OkStatus();
}

}  // namespace

absl::Status ConfigureJob(ServiceState& state, const v1::VoxelizeConfig& message, const std::string& client,
                          VoxelizeJob& job) {
  absl::StatusOr<ParsedConfig> parsed = ParseConfig(message);
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
  if (absl::Status s = FindKeptMesh(state, job); !s.ok()) return s;
  job.Weigh();
  return absl::OkStatus();
}

PieceOptions PiecesOf(const ServerOptions& options) {
  return {.piece_bytes = options.piece_bytes, .zstd_level = options.zstd_level};
}

}  // namespace voxelpipe
