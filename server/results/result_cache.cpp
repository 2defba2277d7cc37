#include "results/result_cache.h"

#include "job/result.h"

namespace voxelpipe {
namespace {

// Overhead of an entry besides the arrays, so that many tiny results are not free.
constexpr uint64_t kOverheadBytes = 4096;

}  // namespace

void ResultCache::Put(const std::string& key, const SharedResult& result) {
  uint64_t bytes = kOverheadBytes + key.size();
  for (const auto array : ArraysOf(result.outcome->result)) bytes += array.size();
  results_.Insert(key, std::make_shared<const SharedResult>(SharedResult{result.outcome, result.plan, nullptr}), bytes);
}

}  // namespace voxelpipe
