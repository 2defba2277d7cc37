// The pool of processes that load meshes for the server.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "isolate/worker_process.h"
#include "load/load_mesh.h"

namespace voxelpipe {

struct LoadWorkersOptions {
  int workers = 1;            // maximum number of processes, until SetWorkers
  int threads = 1;            // of a process that runs alone; several share them
  uint64_t memory_bytes = 0;  // limit for loading one mesh, if the job has no smaller budget; 0: none
  std::chrono::milliseconds unused{
      10'000};  // afterwards all but one end, and that one releases unused memory; 0: never
  // Memory that all processes together keep between requests, of each kind (WorkerProcess::Options), until SetWorkers.
  // Each keeps its share, at least 2 MiB and at most 64 MiB.
  uint64_t kept_bytes = 64 << 20;
  WorkerProcess::Options process;  // kept_bytes is ignored
};

// Thread-safe. The failure of one process affects no other job. One process is always kept idle, unless all are busy.
class LoadWorkers {
 public:
  // Returns when the first process is ready. UNAVAILABLE with the reason why none can be.
  static absl::StatusOr<std::unique_ptr<LoadWorkers>> Start(const LoadWorkersOptions& options);
  // No call may be running.
  ~LoadWorkers();

  // LoadMeshFor (load/load_mesh.h) in one of the processes, with the result checked here; then the file is freed.
  // Waits for a process if all are busy. Errors: those of LoadMeshFor; the job's, within 100 ms; RESOURCE_EXHAUSTED if
  // the process exceeds its memory or time limit; INTERNAL if it dies or returns an invalid mesh; UNAVAILABLE if none
  // can be started. May throw bad_alloc.
  absl::StatusOr<LoadedMesh> Load(std::vector<uint8_t> file, const LoadRequest& request, const JobContext& job);

  // PrepareTexturesFor (load/decode/image.h) in one of the processes, in the same way.
  absl::Status DecodeTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use,
                              const JobContext& job);

  // Sets the maximum number of processes and the memory that they keep together (LoadWorkersOptions). Surplus processes
  // end when they become idle, and so do those that keep more than their new share.
  void SetWorkers(int workers, uint64_t kept_bytes);

  struct Stats {
    int processes = 0, busy = 0;
    uint64_t questions = 0;                 // sent requests
    uint64_t kept_bytes = 0;                // limit of the memory that idle processes keep together, of each kind
    std::map<std::string, uint64_t> ended;  // processes that ended abnormally, by reason (WorkerProcess::end_reason)
  };
  Stats stats() const;

 private:
  class Lease;
  struct Idle {
    std::unique_ptr<WorkerProcess> process;
    std::chrono::steady_clock::time_point since;
    bool trimmed = false;
  };

  explicit LoadWorkers(const LoadWorkersOptions& options)
      : options_(options), most_(MostOf(options.workers)), kept_bytes_(options.kept_bytes) {}
  static size_t MostOf(int workers) { return size_t(workers < 1 ? 1 : workers); }
  // The memory limit of one load.
  uint64_t MemoryFor(const JobContext& job) const;
  // Out: the number of threads that it may use now.
  uint32_t CountQuestion();
  // WorkerProcess::Ask of one of the processes; of another one, if that has ended without reading the question.
  // `write`: adds what is asked about; maybe several times.
  absl::Status Ask(MessageKind kind, const LoadRequest& request, const JobContext& job,
                   const std::function<void(ArchiveWriter&)>& write,
                   const std::function<absl::Status(ArchiveReader&)>& read, MemoryCharge& kept);
  absl::StatusOr<std::unique_ptr<WorkerProcess>> Take(const JobContext& job);
  void GiveBack(std::unique_ptr<WorkerProcess> process);
  // The thread that starts processes (they end with it), reaps them, and ends idle ones.
  void Maintain();
  void LookForIdle(std::chrono::steady_clock::time_point now);
  // Takes the processes out of the idle ones that have ended by themselves; the thread replaces them.
  void DropEnded();
  size_t Wanted() const;
  // The memory that one process may keep.
  uint64_t KeptShare() const;

  const LoadWorkersOptions options_;
  mutable std::mutex mutex_;
  size_t most_;
  uint64_t kept_bytes_;
  std::condition_variable freed_, work_;  // for callers that wait for a process; for the thread
  std::vector<Idle> idle_;                // most recently used at the back
  std::vector<std::unique_ptr<WorkerProcess>> ended_;
  size_t busy_ = 0, waiting_ = 0;
  uint64_t starts_failed_ = 0;
  absl::Status start_failure_;
  Stats stats_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace voxelpipe
