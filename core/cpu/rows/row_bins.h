// Bins triangles by the slabs of layers that they touch; each thread fills bins of its own.
#pragma once

#include <cstdint>
#include <vector>

#include "cpu/base/task_sizes.h"
#include "grid/host_buffer.h"

namespace voxelpipe::cpu {

// Allocates blocks of kBlock values from pooled memory. Not thread-safe.
template <typename T, uint64_t kBlock>
class BlockArena {
 public:
  // Throws std::bad_alloc.
  T* Take() {
    if (left_ == 0) {
      chunks_.emplace_back(kBlock * kBlocksAtOnce);
      next_ = chunks_.back().data();
      left_ = kBlocksAtOnce;
    }
    --left_;
    T* const block = next_;
    next_ += kBlock;
    return block;
  }

 private:
  static constexpr uint64_t kBlocksAtOnce = kBinChunkBytes / (kBlock * sizeof(T));

  std::vector<HostArray<T>> chunks_;
  T* next_ = nullptr;
  uint64_t left_ = 0;
};

// For each bin a list of values in blocks: appending costs one comparison and one store.
template <typename T>
class Bins {
 public:
  static constexpr uint64_t kBlock = 1024;

  explicit Bins(size_t bins) : lists_(bins) {}

  void Push(size_t bin, T value) {
    List& list = lists_[bin];
    if (list.next == list.end) {
      T* const block = arena_.Take();
      list.blocks.push_back(block);
      list.next = block;
      list.end = block + kBlock;
    }
    *list.next++ = value;
  }

  // Calls visit(values, count) for each block of a bin.
  template <typename Visit>
  void ForEachBlock(size_t bin, const Visit& visit) const {
    const List& list = lists_[bin];
    for (size_t i = 0; i < list.blocks.size(); ++i) {
      const bool last = i + 1 == list.blocks.size();
      visit(list.blocks[i], int64_t(last ? list.next - list.blocks[i] : kBlock));
    }
  }

 private:
  struct List {
    std::vector<T*> blocks;
    T *next = nullptr, *end = nullptr;
  };

  std::vector<List> lists_;
  BlockArena<T, kBlock> arena_;
};

}  // namespace voxelpipe::cpu
