// The A-buffer's fragments of a mesh's few largest triangles: they come sorted, and need no part in sorting all others. They are listed behind what
// the run's stream works on, where that leaves the device something to do.
#pragma once

#include <cstdint>
#include <utility>

#include "absl/status/statusor.h"
#include "cuda/apart_views.h"
#include "cuda/bucket_views.h"
#include "cuda/buffer.h"
#include "cuda/device.h"
#include "cuda/pinned.h"

namespace voxelpipe::cuda {

struct RunState;

// A list of them, of one slab, by voxel and then by triangle. Movable; at its end it waits for the work on it.
class ApartFragments {
 public:
  // Whether they are listed apart: of scattered meshes whose largest triangles are known (scattered.h), in grids where those may have many rows.
  static bool Pays(const RunState& state);
  // With room for as many as there are most often. The triangles are set up already, when the run's stream has done its work so far.
  static absl::StatusOr<ApartFragments> Make(const RunState& state);

  // Begins to list them, beside what the run's stream gets from now on and after its work so far.
  absl::Status Start(const RunState& state);
  // Waits until they are listed, which was begun.
  absl::Status Wait(const RunState& state);
  // Once that is done.
  SortedFragments sorted() const { return {keys_.data(), triangles_.data(), count_}; }

 private:
  explicit ApartFragments(DeviceUse&& use) : use_(std::move(use)) {}
  absl::Status MakeRoom(const RunState& state, uint64_t fragments);
  ApartArgs Args(const RunState& state);
  absl::Status SetUp(const RunState& state);

  DeviceArray<uint32_t> keys_, triangles_;
  DeviceArray<uint8_t> room_;  // what the kernels keep
  PinnedBuffer listed_;
  uint64_t count_ = 0;
  DeviceUse use_;  // last: it waits
};

// Merges what state.apart has with state.fragments, which are sorted, and forgets it.
absl::Status MergeApart(RunState& state);
// The same, and buckets of all; keys are not kept. As CountAndListBuckets (fragments.h), but for keys.first.
absl::Status MergeApartIntoBuckets(RunState& state, BucketArgs<uint64_t> buckets);

}  // namespace voxelpipe::cuda
