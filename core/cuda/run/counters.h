// Counters of a run on the device, in one array, so that the host reads all in one copy. No host-only includes.
#pragma once

#include "cuda/primitives/coverage_record.h"
#include "cuda/primitives/span.h"

namespace voxelpipe::cuda {

// Elements of RunState::counters.
enum Counter : int {
  kFragments,   // of the slab
  kOddColumns,  // of the slab
  kVoxels,      // of the slab, with a fragment or filled
  kListedBricks,
  kListedVoxels,  // of a sparse result
  kChanged,       // flood: rows changed
  kRanks,         // voxels with a rank
  kBuckets,       // of the slab
  kBundles,       // of the slab's fragments
  kCrossings,     // of lines and parts, listed in one range of rows
  kPooled,        // bricks that wanted a place in the pool
  kCleared,       // blocks that have cleared their part of a bit grid; 0 again when it is drawn
  kNever,         // always 0
  kScratch0,      // free for use within a stage
  kQueued0,       // entries of the queues of a stage
  kQueued1,
  kQueued2,
  kQueued3,
  kSpans,    // of the list; the queues and it are cleared in one, at the end
  kCounters  // behind them: kFragmentSlots, kChunkGroups (span.h)
};
inline constexpr int kAllCounters = kCounters + kFragmentSlots + kChunkGroups;

}  // namespace voxelpipe::cuda
