// Draco streams of a glTF document, decoded several at once.
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

// Decodes a few streams ahead of their use, in parallel; what comes out, and which error comes first, is as if each
// were decoded when it is taken. Not thread-safe.
class DracoAhead {
 public:
  // In: the streams in the order in which they will be taken. Views; `job` and `limits` too must outlive this.
  DracoAhead(const JobContext& job, std::vector<std::span<const uint8_t>> streams, const LoadLimits& limits)
      : job_(job), streams_(std::move(streams)), limits_(limits) {}

  // DecodeDraco(bytes), or the job's error once it is over. A stream that is not the next one is decoded here and now.
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
