// A set of whole numbers below a bound, as a tree of bits: a bit of a node says whether its 64 children hold any.
// Source: P. van Emde Boas, "Preserving order in a forest in less than logarithmic time and linear space", 1977.
// Changed: nodes of 64 children, found by the instructions that count zeros.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace voxelpipe::cpu {

// Each call takes a time that grows with the number of levels: 2 up to 4,096 numbers, 4 up to 16 million.
class IndexSet {
 public:
  // Empty, of numbers in [0, bound); bound > 0.
  explicit IndexSet(int64_t bound) : nodes_(NodesFor(bound)) {
    size_t first = 0;
    do {
      bound = (bound + 63) / 64;
      first_[levels_] = first;
      size_[levels_++] = bound;
      first += size_t(bound);
    } while (bound > 1);
  }

  static uint64_t BytesFor(int64_t bound) { return NodesFor(bound) * sizeof(uint64_t); }

  bool empty() const { return nodes_.back() == 0; }
  void Clear() { std::fill(nodes_.begin(), nodes_.end(), 0); }

  void Insert(int64_t number) {
    for (size_t level = 0; level < levels_; ++level, number >>= 6) {
      uint64_t& node = Node(level, number >> 6);
      const bool known = node != 0;  // to the levels above
      node |= uint64_t{1} << (number & 63);
      if (known) return;
    }
  }

  // Takes out the least number that is at least `from`; where there is none, the least of all. Only if not empty.
  int64_t Take(int64_t from) {
    int64_t number = Find(from);
    if (number < 0) number = Find(0);
    int64_t bit = number;
    for (size_t level = 0; level < levels_; ++level, bit >>= 6) {
      uint64_t& node = Node(level, bit >> 6);
      node &= ~(uint64_t{1} << (bit & 63));
      if (node != 0) break;
    }
    return number;
  }

 private:
  static constexpr size_t kMaxLevels = 11;  // of 64-bit numbers

  static uint64_t NodesFor(int64_t bound) {
    uint64_t nodes = 0;
    do {
      bound = (bound + 63) / 64;
      nodes += uint64_t(bound);
    } while (bound > 1);
    return nodes;
  }

  uint64_t& Node(size_t level, int64_t node) { return nodes_[first_[level] + size_t(node)]; }

  // The least number that is at least `from`, or -1.
  int64_t Find(int64_t from) {
    for (size_t level = 0; level < levels_ && from >> 6 < size_[level]; ++level, from = (from >> 6) + 1) {
      const uint64_t bits = Node(level, from >> 6) >> (from & 63);
      if (bits == 0) continue;
      int64_t found = from + std::countr_zero(bits);
      while (level-- > 0) found = found * 64 + std::countr_zero(Node(level, found));
      return found;
    }
    return -1;
  }

  std::array<size_t, kMaxLevels> first_{};  // of a level, in nodes_
  std::array<int64_t, kMaxLevels> size_{};  // nodes of a level
  size_t levels_ = 0;
  std::vector<uint64_t> nodes_;
};

}  // namespace voxelpipe::cpu
