// What all calls of one server share.
#pragma once

#include <atomic>
#include <cstdint>

#include "calls/call_gate.h"
#include "observe/metrics.h"
#include "options.h"
#include "work/byte_budget.h"
#include "work/job.h"
#include "work/worker_pool.h"

namespace voxelpipe {

// Largest request message. Meshes beyond it come in several pieces.
inline constexpr int kMaxMessageBytes = 64 << 20;
// Bytes of a result in one response message.
inline constexpr uint64_t kPieceBytes = 1 << 20;
// Pieces of a streamed result that wait for the client; the worker waits beyond that.
inline constexpr size_t kMaxPiecesInFlight = 4;

// Thread-safe. Must outlive every call.
struct ServiceState {
  // `resolved`: options without zeros that mean "choose" (Resolve).
  explicit ServiceState(const ServerOptions& resolved)
      : options(resolved),
        uploads(resolved.max_upload_bytes),
        working(resolved.max_working_bytes),
        pool(resolved.workers, resolved.max_queue) {
    limits.load.max_file_bytes = resolved.max_file_bytes;
    limits.plan.max_result_bytes = resolved.max_result_bytes;
    limits.plan.max_working_bytes = resolved.max_working_bytes;
    limits.plan.slab_bytes = resolved.stream_above_mb << 20;
  }

  const ServerOptions options;
  Metrics metrics;
  JobLimits limits;
  ByteBudget uploads;  // mesh files that are being received or wait
  ByteBudget working;  // predicted peaks of the jobs that run, results that are being sent
  CallGate gate;       // closed while the server drains
  std::atomic<uint64_t> next_request_id{1};
  WorkerPool pool;  // last, so that its jobs end before the budgets go
};

}  // namespace voxelpipe
