// Traversal operation that sets bits in the grids of a batch. No host-only includes.
#pragma once

#include "cuda/batch/batch_kernel.cuh"
#include "cuda/traversal/raster_args.cuh"

namespace voxelpipe::cuda {

// kFirst: the member that has the offset of an item's grid in `bits`.
template <uint64_t BatchItemView::*kFirst>
class SetBatchBits {
 public:
  SetBatchBits(const BatchWalkArgs& walk, uint32_t* bits) : items_(walk.items), item_of_(walk.item_of), bits_(bits) {}

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t t) { item_ = items_ + item_of_[t]; }
  __device__ void End(uint32_t) const {}
  __device__ void Finish() const {}
  __device__ void Row(int y, int z, int x_begin, int x_end) const { Set(*item_, y, z, x_begin, x_end); }
  __device__ void SharedRow(uint32_t t, int y, int z, int x_begin, int x_end) const {
    Set(items_[item_of_[t]], y, z, x_begin, x_end);
  }

 private:
  __device__ void Set(const BatchItemView& of, int y, int z, int x_begin, int x_end) const {
    SetRow(bits_ + of.*kFirst + of.grid.Word(0, y, z), x_begin, x_end, of.look_first);
  }

  const BatchItemView* items_;
  const uint32_t* item_of_;
  uint32_t* bits_;
  const BatchItemView* item_ = nullptr;  // of the current triangle
};

}  // namespace voxelpipe::cuda
