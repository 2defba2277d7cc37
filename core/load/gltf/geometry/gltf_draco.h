// Draco streams of a glTF document, several decoded in parallel.
#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/decode/draco.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe::gltf {

// Decodes a few streams ahead of their use, in parallel; results and the first error are the same as if each were
// decoded when it is taken. Not thread-safe.
class DracoAhead {
 public:
  // In: the streams in the order in which they will be taken. They are views; they, `job` and `limits` must outlive
  // this.
  DracoAhead(const JobContext& job, std::vector<std::span<const uint8_t>> streams, const LoadLimits& limits)
      : job_(job), streams_(std::move(streams)), limits_(limits) {}

  // DecodeDraco(bytes), or the job's error once it ended. A stream out of order is decoded immediately.
  absl::StatusOr<DracoMesh> Take(std::span<const uint8_t> bytes);

 private:
  struct Decoded {
    absl::Status status;
    DracoMesh mesh;
  };
  void DecodeSome();

  const JobContext& job_;
  std::vector<std::span<const uint8_t>> streams_;
  const LoadLimits& limits_;
  size_t taken_ = 0;
  std::deque<Decoded> ready_;  // of streams_[taken_] and on
};

}  // namespace voxelpipe::gltf
