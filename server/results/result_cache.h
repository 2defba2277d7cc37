// A cache of finished results, for repeated requests.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "jobs/job.h"
#include "meshes/byte_lru.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe {

// The result that all equal jobs receive.
struct SharedResult {
  std::shared_ptr<const JobOutcome> outcome;  // with its sums
  Plan plan;
  std::shared_ptr<const void> memory;  // the charge of the result to the server's memory while a call reads it
};

// Off if `max_bytes` is 0. Results by their request (RequestKey), up to `max_bytes` bytes; evicts the least recently
// used. Thread-safe.
class ResultCache {
 public:
  explicit ResultCache(uint64_t max_bytes) : results_(max_bytes) {}

  bool enabled() const { return results_.limit_bytes() > 0; }
  // Null if there is none.
  std::shared_ptr<const SharedResult> Use(const std::string& key) { return results_.Use(key); }
  // Stores the outcome, unless it is larger than the cache; without its charge to the server's memory, because the
  // cache has its own budget.
  void Put(const std::string& key, const SharedResult& result);

  LruStats stats() const { return results_.stats(); }
  uint64_t max_bytes() const { return results_.limit_bytes(); }

 private:
  ByteLru<const SharedResult> results_;
};

}  // namespace voxelpipe
