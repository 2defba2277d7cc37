// The task of most calls: one mesh to one result.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "job/result.h"
#include "job/resuming_sink.h"
#include "jobs/job.h"
#include "jobs/result_export.h"
#include "load/costly_parts.h"
#include "meshes/mesh_store.h"
#include "pipeline/voxelize.h"
#include "schedule/task.h"
#include "wire/request.h"

namespace voxelpipe {

// The receiver of the result derives from this, and sets the public members before Submit.
class VoxelizeJob : public Task {
 public:
  explicit VoxelizeJob(JobContext::Progress progress = {}) : context(std::move(progress)) {}

  bool loaded() const final;
  void Weigh() final;
  bool Load() final;
  void Refuse(absl::Status why) final { Done(std::move(why)); }
  // Makes `mesh` from `kept` and `pieces`, unless already done.
  absl::Status Prepare();
  // True if Prepare has nothing to do but to take a stored mesh.
  bool prepared_at_once() const { return mesh || (!kept.empty() && !makes_of_kept() && pieces.empty()); }
  // After the run: frees the meshes, and the list of placed ones.
  void FreeMesh();

  ParsedConfig config;
  JobContext context;
  const JobLimits* limits = nullptr;
  MeshStore* store = nullptr;  // the store of `kept`
  // The mesh of config.mesh_name, or those of config.placed in their order; empty for a file.
  std::vector<std::shared_ptr<KeptMesh>> kept;
  std::deque<std::string> pieces;        // of the mesh file, or of the stored mesh's new positions; freed after loading
  std::shared_ptr<MemoryBudget> memory;  // of the request (MakeRequestMemory); null: that of the process
  std::shared_ptr<const PreparedMesh> mesh;  // made from these; keeps `memory` alive
  std::unique_ptr<ResultExport> exported;    // takes the result in place of the call; null: the call does
  uint32_t attempts = 0;                     // device workers that tried it
  // The outcome of an equal job before: then nothing is run, and a loader calls DoneShared with it.
  std::shared_ptr<const JobOutcome> ready;
  Plan ready_plan;
  bool planned = false;  // Planned was OK
  ResumingSink resumed;  // before large_results(): drops what was already delivered

  // Called by the worker that runs the job, before rasterization. A status other than OK ends the job with it. If the
  // memory of the job is not available, waits for it, or returns ABORTED if it must not wait: the job then runs alone
  // later, and this is called again. Not called again after OK: if a device fails and the job is repeated, its memory
  // is already charged.
  virtual absl::Status Planned(const Plan& plan, bool may_wait) = 0;
  // The sink of dense results of more than one slab, slab by slab; null: they are refused with RESOURCE_EXHAUSTED
  // beyond the memory limit. That of `exported` if there is one.
  virtual ResultSink* large_results() = 0;
  // Called at the end, exactly once, from any thread, unless the job was withdrawn.
  virtual void Done(absl::StatusOr<JobOutcome> outcome) = 0;

  // If one run serves several equal jobs (ResultSharing), these are called instead of Planned, and instead of Done with
  // a result. PlanShared may be omitted, and may come after DoneShared for jobs that join late. `cached`: this job did
  // not start the run.
  virtual void PlanShared(const Plan& /*plan*/) {}
  virtual void DoneShared(const std::shared_ptr<const JobOutcome>& /*outcome*/, const Plan& /*plan*/, bool /*cached*/) {
    Done(absl::InternalError("a shared result for a job that shares none"));
  }

 private:
  // The device worker itself loads smaller files, several at once, because a second hand-over would take longer; except
  // those that may nevertheless take long and delay the other jobs of a batch.
  static constexpr uint64_t kLoadedByWorker = 256 << 10;
  static constexpr double kMadeByWorkerMs = 0.5;  // the same of meshes that are placed or cut

  uint64_t file_bytes() const;
  // The mesh is made of those of the store: several are placed, or parts are left out.
  bool makes_of_kept() const { return config.placed || (!kept.empty() && !config.request.parts.exclude.empty()); }
  // Decoding textures of a stored mesh takes as long as loading it did.
  bool has_textures() const;

  CostlyParts costly_;  // of the file; set by Weigh
};

}  // namespace voxelpipe
