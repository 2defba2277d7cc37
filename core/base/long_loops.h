// Loops over arrays whose lengths untrusted files choose: they end soon after the job.
// Source of the sort: C. A. R. Hoare, "Quicksort", 1962. Its pivots are random, so that no file can make it slow.
#pragma once

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"

namespace voxelpipe {

inline constexpr uint64_t kElementsAStep = 1 << 15;  // between two polls of the job

// Calls body(begin, end) for steps of [0, count), in order, checking the job before each of them.
template <typename Body>
absl::Status InSteps(const JobContext& job, uint64_t count, const Body& body) {
  for (uint64_t begin = 0; begin < count; begin += kElementsAStep) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    body(begin, std::min(count, begin + kElementsAStep));
  }
  return absl::OkStatus();
}

// Makes `values` at least `count` long. Its resize takes long where it writes fresh pages.
template <typename T>
absl::Status Resize(const JobContext& job, std::vector<T>& values, uint64_t count, const T& value = T()) {
  values.reserve(count);
  return InSteps(job, count, [&](uint64_t, uint64_t end) {
    if (end > values.size()) values.resize(end, value);
  });
}

// Parts of ParallelSort.
namespace quicksort {

inline constexpr ptrdiff_t kSortedAtOnce = 1 << 12;

// The median of some random elements; `random` is the state of the random numbers.
template <typename T, typename Less>
T Pivot(const T* begin, const T* end, const Less& less, uint64_t& random) {
  T sample[9];
  for (T& element : sample) {
    random = random * 6364136223846793005u + 1442695040888963407u;  // D. E. Knuth's MMIX
    element = begin[(random >> 16) % uint64_t(end - begin)];
  }
  std::nth_element(sample, sample + 4, sample + 9, less);
  return sample[4];
}

// Moves the elements so that none of [begin, middle) is above the pivot and none of [middle, end) is below it. Out: the
// middle, with at least one element on each side; null if the job ended.
template <typename T, typename Less>
T* Partition(const JobContext& job, T* begin, T* end, const Less& less, const T& pivot) {
  uint64_t seen = 0;
  const auto over = [&] { return ++seen % kElementsAStep == 0 && !job.Check().ok(); };
  for (T *i = begin, *j = end - 1;; ++i, --j) {
    for (; less(*i, pivot); ++i) {
      if (over()) return nullptr;
    }
    for (; less(pivot, *j); --j) {
      if (over()) return nullptr;
    }
    if (i >= j) return std::max(i, begin + 1);
    std::swap(*i, *j);
    if (over()) return nullptr;
  }
}

template <typename T, typename Less>
void Sort(const JobContext& job, T* begin, T* end, const Less& less, uint64_t random) {
  if (!job.Check().ok()) return;
  if (end - begin <= kSortedAtOnce) return std::sort(begin, end, less);
  const T pivot = Pivot(begin, end, less, random);
  T* const middle = Partition(job, begin, end, less, pivot);
  if (middle == nullptr) return;
  tbb::parallel_invoke([&] { Sort(job, begin, middle, less, random); }, [&] { Sort(job, middle, end, less, ~random); });
}

}  // namespace quicksort

// Sorts in place, in parallel. tbb::parallel_sort cannot be ended within a second, and takes long for some inputs.
// Expected O(n log n) time. Errors: the job's; the elements are then in any order.
template <typename T, typename Less = std::less<T>>
absl::Status ParallelSort(const JobContext& job, std::vector<T>& values, const Less& less = Less()) {
  if (values.size() <= quicksort::kSortedAtOnce) {
    std::sort(values.begin(), values.end(), less);
    return job.Check();
  }
  bool sorted = true;
  absl::Status over = InSteps(job, values.size(), [&](uint64_t begin, uint64_t end) {
    const T* const first = values.data();
    sorted = sorted && std::is_sorted(first + begin - (begin > 0 ? 1 : 0), first + end, less);
  });
  if (!over.ok() || sorted) return over;
  quicksort::Sort(job, values.data(), values.data() + values.size(), less, std::random_device()());
  return job.Check();
}

}  // namespace voxelpipe
