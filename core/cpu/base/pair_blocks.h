// A list that grows by blocks: elements are never copied, and little memory is left over.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace voxelpipe::cpu {

class PairBlocks {
 public:
  // Reserves one block for `count` pairs. Call before the first push_back. Throws std::bad_alloc, as push_back does.
  void reserve(size_t count) { Grow(count); }

  void push_back(uint64_t pair) {
    if (next_ == end_) Grow(std::max(kMinBlock, total_ / kShare));
    *next_++ = pair;
  }

  size_t size() const { return total_ - size_t(end_ - next_); }

  // Calls visit(pair) in the order of insertion.
  template <typename Visit>
  void ForEach(const Visit& visit) const {
    for (size_t i = 0; i < blocks_.size(); ++i) {
      const uint64_t* const begin = blocks_[i].pairs.get();
      const uint64_t* const end = i + 1 == blocks_.size() ? next_ : begin + blocks_[i].count;
      for (const uint64_t* pair = begin; pair != end; ++pair) visit(*pair);
    }
  }

  void clear() {
    blocks_ = std::vector<Block>();
    next_ = end_ = nullptr;
    total_ = 0;
  }

 private:
  static constexpr size_t kMinBlock = 512, kShare = 8;  // pairs of a block: at least; the share of all pairs

  struct Block {
    std::unique_ptr<uint64_t[]> pairs;
    size_t count;
  };

  void Grow(size_t count) {
    blocks_.push_back({std::make_unique_for_overwrite<uint64_t[]>(count), count});
    next_ = blocks_.back().pairs.get();
    end_ = next_ + count;
    total_ += count;
  }

  std::vector<Block> blocks_;
  uint64_t *next_ = nullptr, *end_ = nullptr;
  size_t total_ = 0;
};

}  // namespace voxelpipe::cpu
