// The task that most calls are: one mesh to one result.
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
  // Makes `mesh` of `kept` and `pieces`, if that was not done.
  absl::Status Prepare();

  ParsedConfig config;
  JobContext context;
  const JobLimits* limits = nullptr;
  MeshStore* store = nullptr;      // where `kept` comes from
  std::shared_ptr<KeptMesh> kept;  // the mesh that config.mesh_id names; null where a file is given
  std::deque<std::string> pieces;  // of the mesh file, or of the kept mesh's new positions; freed once they are loaded
  std::shared_ptr<MemoryBudget> memory;      // of the request (MakeRequestMemory); null: the process's
  std::shared_ptr<const PreparedMesh> mesh;  // made of these; keeps `memory` alive
  uint32_t attempts = 0;                     // device workers that had it
  bool planned = false;                      // Planned was OK
  ResumingSink resumed;                      // before large_results(): what went there already

  // Called by the worker that runs the job, before rasterization. A status other than OK ends the job with it. Where
  // what the job needs is not there now, waits for it, or, if it must not wait, returns ABORTED: the job then runs
  // alone later, and this is called again. Not called any more after an OK: where a device failed and the job is run
  // again, what it needs is there.
  virtual absl::Status Planned(const Plan& plan, bool may_wait) = 0;
  // Where dense results of more than one slab go, slab after slab; null: they are refused with RESOURCE_EXHAUSTED
  // beyond the memory limit.
  virtual ResultSink* large_results() = 0;
  // The end, exactly once, from any thread, unless the job was withdrawn.
  virtual void Done(absl::StatusOr<JobOutcome> outcome) = 0;

  // Where one run serves several equal jobs (ResultSharing), these are called in place of Planned, and of Done with a
  // result. PlanShared may be left out, and may come after DoneShared to those that join late. `cached`: this job was
  // not the one that made the run start.
  virtual void PlanShared(const Plan& /*plan*/) {}
  virtual void DoneShared(const std::shared_ptr<const JobOutcome>& /*outcome*/, const Plan& /*plan*/, bool /*cached*/) {
    Done(absl::InternalError("a shared result for a job that shares none"));
  }

 private:
  // Smaller files are loaded by the device worker itself, several at once: handing them over twice would take longer.
  // Not those that may take long all the same, and delay the other jobs of a batch.
  static constexpr uint64_t kLoadedByWorker = 256 << 10;

  uint64_t file_bytes() const;

  CostlyParts costly_;  // of the file; Weigh finds them
};

}  // namespace voxelpipe
