// What a parser of a mesh file may take: the job's time and memory, and the limits of loading.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "base/job_context.h"
#include "load/base/charged_growth.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe {

// Charges lists to the job's memory before they grow. Its errors begin with the name of the format. Not thread-safe.
class LoadBudget {
 public:
  // `job` and `limits` must outlive this. `format`: the name for errors, such as "STL".
  LoadBudget(const JobContext& job, const LoadLimits& limits, std::string_view format)
      : job_(job), limits_(limits), format_(format), charge_(&MemoryOf(job)) {}

  // Charges elements * bytes_each. RESOURCE_EXHAUSTED naming `what`; the job's error once it is over.
  absl::Status Take(uint64_t elements, uint64_t bytes_each, std::string_view what) {
    if (absl::Status over = job_.Check(); !over.ok()) return over;
    return charge_.Grow(elements, bytes_each, absl::StrCat(format_, ": ", std::string(what), ":"));
  }

  // Room in a list for `more` elements. A list that grows does so to twice its size; all of it stays charged.
  template <typename T>
  absl::Status MakeRoom(std::vector<T>& list, uint64_t more, std::string_view what) {
    if (list.capacity() - list.size() >= more) [[likely]] return absl::OkStatus();  // inline: asked for every element
    return Grow(list, more, what);
  }

  // Frees a list that MakeRoom made room in.
  template <typename T>
  void Drop(std::vector<T>& list) {
    charge_.ShrinkTo(charge_.bytes() - list.capacity() * sizeof(T));
    std::vector<T>().swap(list);
  }

  // RESOURCE_EXHAUSTED naming the limit, for so many triangles or vertices in all.
  absl::Status CheckTriangles(uint64_t count) const { return CheckCount(count, "triangles", limits_.max_triangles); }
  absl::Status CheckVertices(uint64_t count) const {
    return CheckCount(count, "vertices", std::min<uint64_t>(limits_.max_vertices, UINT32_MAX));
  }

  // INVALID_ARGUMENT "FORMAT: what".
  template <typename... Parts>
  absl::Status Invalid(const Parts&... what) const {
    return absl::InvalidArgumentError(absl::StrCat(format_, ": ", what...));
  }

  const JobContext& job() const { return job_; }
  const LoadLimits& limits() const { return limits_; }
  const std::string& format() const { return format_; }
  // Moves the charge out, for Scene::memory.
  std::shared_ptr<MemoryCharge> Release() { return std::make_shared<MemoryCharge>(std::move(charge_)); }

 private:
  template <typename T>
  [[gnu::noinline]] absl::Status Grow(std::vector<T>& list, uint64_t more, std::string_view what) {
    if (absl::Status over = job_.Check(); !over.ok()) return over;
    return MakeChargedRoom(charge_, list, more, absl::StrCat(format_, ": ", std::string(what), ":"));
  }
  absl::Status CheckCount(uint64_t count, const char* what, uint64_t limit) const {
    if (count <= limit) return absl::OkStatus();
    return absl::ResourceExhaustedError(
        absl::StrCat(format_, ": ", count, " ", what, "; the limit max_", what, " is ", limit));
  }

  const JobContext& job_;
  const LoadLimits& limits_;
  const std::string format_;
  MemoryCharge charge_;
};

}  // namespace voxelpipe
