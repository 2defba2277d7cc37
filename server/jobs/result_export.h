// Results that leave the server another way than as messages of their call.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_format.h"
#include "base/job_context.h"
#include "job/result.h"
#include "jobs/job.h"
#include "wire/request.h"

namespace voxelpipe {

// Takes the result of one job, as the last stage of the job: on its worker, in the job's memory, until the job is
// cancelled. Owned by the job. Not thread-safe.
class ResultExport {
 public:
  virtual ~ResultExport() = default;
  // The sink of a result that is not in memory as a whole; the same one if the run is repeated.
  virtual ResultSink& sink() = 0;
  // The run has succeeded. Reads the arrays of `outcome`, unless they went to the sink, and ends the export. Out: its
  // bytes.
  virtual absl::StatusOr<uint64_t> Close(const JobOutcome& outcome) = 0;
};

// Makes the export of a job, before its mesh is loaded. May fill in what the request leaves open. `job` outlives the
// export, which may cancel it. INVALID_ARGUMENT if a result of such a request cannot be exported.
using MakeExport = std::function<absl::StatusOr<std::unique_ptr<ResultExport>>(ParsedConfig& config, JobContext& job)>;

// Exports that another part of this process offers to a call that it makes over an in-process channel: a ticket travels
// in the call's metadata. Tickets cannot be guessed, so the same key in a call from elsewhere has no effect.
// Thread-safe.
class ResultExports {
 public:
  static constexpr char kKey[] = "voxelpiped-result-export";

  // An offer, until it is destroyed. `all` must outlive it.
  class Offer {
   public:
    Offer(ResultExports& all, MakeExport make) : all_(all), ticket_(RandomTicket()) {
      const std::lock_guard lock(all_.mutex_);
      all_.offers_.emplace(ticket_, std::move(make));
    }
    ~Offer() {
      const std::lock_guard lock(all_.mutex_);
      all_.offers_.erase(ticket_);
    }
    Offer(const Offer&) = delete;
    Offer& operator=(const Offer&) = delete;

    const std::string& ticket() const { return ticket_; }

   private:
    static std::string RandomTicket() {
      constexpr int kWords = 4;   // 128 bits
      std::random_device random;  // the system's generator
      std::string ticket;
      for (int i = 0; i < kWords; ++i) absl::StrAppendFormat(&ticket, "%08x", uint32_t(random()));
      return ticket;
    }

    ResultExports& all_;
    const std::string ticket_;
  };

  // Takes what was offered with this ticket; null if nothing was, or it was already taken.
  MakeExport Take(const std::string& ticket) {
    const std::lock_guard lock(mutex_);
    const auto found = offers_.find(ticket);
    return found == offers_.end() ? nullptr : std::exchange(found->second, nullptr);
  }

 private:
  std::mutex mutex_;
  std::map<std::string, MakeExport> offers_;
};

}  // namespace voxelpipe
