// The processes that load meshes for the server, kept and used again.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
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
  int workers = 1;            // processes, at most, until SetWorkers
  int threads = 1;            // of one that works alone; several share them
  uint64_t memory_bytes = 0;  // that loading one mesh may take where the job has no smaller budget; 0: no bound
  std::chrono::milliseconds unused{
      10'000};  // then all but one end, and that one gives back what it does not use; 0: never
  // That all processes together keep from question to question, of each kind (WorkerProcess::Options), until
  // SetWorkers. One keeps its share, but at least 2 MiB and at most 64 MiB.
  uint64_t kept_bytes = 64 << 20;
  WorkerProcess::Options process;  // but for kept_bytes
};

// Thread-safe. No call of one job is touched by what happens to the process of another. There is always one process
// that waits, unless all are at work.
class LoadWorkers {
 public:
  // Out: when the first process has said that it is ready. UNAVAILABLE saying why none can be.
  static absl::StatusOr<std::unique_ptr<LoadWorkers>> Start(const LoadWorkersOptions& options);
  // No call may run any more.
  ~LoadWorkers();

  // What LoadMeshFor (load/load_mesh.h) gives, made in one of the processes and checked here; the file is freed
  // then. Waits for one where all are at work.
  // Errors: those of LoadMeshFor; the job's, within 100 ms; RESOURCE_EXHAUSTED where the process takes more memory or
  // time than it may; INTERNAL where it dies or gives what cannot be a mesh; UNAVAILABLE where none can be started. May
  // throw bad_alloc.
  absl::StatusOr<LoadedMesh> Load(std::vector<uint8_t> file, const LoadRequest& request, const JobContext& job);

  // PrepareTexturesFor (load/decode/image.h) likewise.
  absl::Status DecodeTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use,
                              const JobContext& job);

  // From now on so many processes at most, which together keep so much (LoadWorkersOptions). Those beyond end once they
  // are not needed, and those that keep more than their new share end.
  void SetWorkers(int workers, uint64_t kept_bytes);

  struct Stats {
    int processes = 0, busy = 0;
    uint64_t questions = 0;   // that were asked
    uint64_t kept_bytes = 0;  // that the processes which are not busy may keep together, of each kind
    std::map<std::string, uint64_t>
        ended;  // processes that did not end in order, by reason (WorkerProcess::end_reason)
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
  // How much one load may take.
  uint64_t MemoryFor(const JobContext& job) const;
  // Out: the threads that it may use now.
  uint32_t CountQuestion();
  absl::StatusOr<std::unique_ptr<WorkerProcess>> Take(const JobContext& job);
  void GiveBack(std::unique_ptr<WorkerProcess> process);
  // The thread that starts processes (they end with it), buries them, and looks for idle ones.
  void Maintain();
  void LookForIdle(std::chrono::steady_clock::time_point now);
  size_t Wanted() const;
  // What one process may keep.
  uint64_t KeptShare() const;

  const LoadWorkersOptions options_;
  mutable std::mutex mutex_;
  size_t most_;
  uint64_t kept_bytes_;
  std::condition_variable freed_, work_;  // for those who wait for a process; for the thread
  std::vector<Idle> idle_;                // used last at the back
  std::vector<std::unique_ptr<WorkerProcess>> ended_;
  size_t busy_ = 0, waiting_ = 0;
  uint64_t starts_failed_ = 0;
  absl::Status start_failure_;
  Stats stats_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace voxelpipe
