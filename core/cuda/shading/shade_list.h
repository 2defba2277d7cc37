// The kernels that run fragment shaders on lists of fragments. No other kernel does, but those that shade a value a
// triangle (blend_spans.cuh) and tiles (fine_raster_kernel.cuh). Included by .cu files only.
#pragma once

#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Fragments of the slab, and where their values go.
struct FragmentList {
  const uint32_t* keys = nullptr;       // voxels: their indices within the slab
  const uint32_t* triangles = nullptr;  // kNoTriangleListed: no fragment
  uint64_t count = 0;
  const uint32_t* to = nullptr;  // the element that a fragment's value becomes; null: its number in the list
  uint64_t plane = 0;            // elements of a plane of a planar target
};

// Writes the values of one target's fragments to `out`, in the result's layout; with list.to, a bit target's to a
// cleared bit grid.
absl::Status ShadeList(RunState& state, int index, const FragmentList& list, uint8_t* out);
// Writes the values of all targets' fragments.
absl::Status ShadeList(RunState& state, const FragmentList& list, uint8_t* const (&out)[kMaxTargets]);
// A byte a fragment, 1 if some target keeps it.
absl::Status FindKept(RunState& state, const FragmentList& list, uint8_t* kept);

// The first `count` spans of state.lists.spans, whose triangles are numbered from first_triangle on.
struct ListedSpans {
  uint64_t count = 0;
  uint32_t first_triangle = 0;
};

// Shades the fragments of all records, or of spans of the list, for the targets whose values come
// from fragments, and blends them into accumulators.
absl::Status ShadeRecords(RunState& state);
absl::Status ShadeSpans(RunState& state, const ListedSpans& listed);

}  // namespace voxelpipe::cuda
