// Launches fragment shaders on lists of fragments. Other kernels that run shaders: values of triangles
// (blend_spans.cuh) and batches (batch_fragments.cuh, batch_values.cuh). Included by .cu files only.
#pragma once

#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Fragments of the slab, and their outputs.
struct FragmentList {
  const uint32_t* keys = nullptr;       // voxel indices within the slab
  const uint32_t* triangles = nullptr;  // kNoTriangleListed: unused element
  uint64_t count = 0;
  const uint32_t* to = nullptr;  // output element of each fragment; null: its position in the list
  uint64_t plane = 0;            // elements of a plane of a planar target
};

// Writes the values of one target's fragments to `out`, in the result's layout. With list.to, a bit target goes to a
// cleared bit grid.
absl::Status ShadeList(RunState& state, int index, const FragmentList& list, uint8_t* out);
// Writes the values of all targets' fragments.
absl::Status ShadeList(RunState& state, const FragmentList& list, uint8_t* const (&out)[kMaxTargets]);
// Writes one byte per fragment: 1 if some target keeps it.
absl::Status FindKept(RunState& state, const FragmentList& list, uint8_t* kept);

// The first `count` spans of state.lists.spans; their triangle numbers are relative to first_triangle.
struct ListedSpans {
  uint64_t count = 0;
  uint32_t first_triangle = 0;
};

// Shades the fragments of all records, or of listed spans, for the targets whose values come from fragments, and blends
// them into accumulators.
absl::Status ShadeRecords(RunState& state);
absl::Status ShadeSpans(RunState& state, const ListedSpans& listed);

}  // namespace voxelpipe::cuda
