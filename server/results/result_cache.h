// Finished results, for requests that come again.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "jobs/job.h"
#include "meshes/byte_lru.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe {

// What all who asked for the same get.
struct SharedResult {
  std::shared_ptr<const JobOutcome> outcome;  // with its sums
  Plan plan;
  std::shared_ptr<const void> memory;  // the share of the server's memory that the result holds while somebody reads it
};

// Off where `max_bytes` is 0. Results by their request (RequestKey), up to so many bytes; the longest unused go first.
// Thread-safe.
class ResultCache {
 public:
  explicit ResultCache(uint64_t max_bytes) : results_(max_bytes) {}

  bool enabled() const { return results_.limit_bytes() > 0; }
  // Null where there is none.
  std::shared_ptr<const SharedResult> Use(const std::string& key) { return results_.Use(key); }
  // Keeps the outcome, unless it is larger than the cache; its share of the server's memory is not kept with it: the
  // cache has its own.
  void Put(const std::string& key, const SharedResult& result);

  LruStats stats() const { return results_.stats(); }
  uint64_t max_bytes() const { return results_.limit_bytes(); }

 private:
  ByteLru<const SharedResult> results_;
};

}  // namespace voxelpipe
