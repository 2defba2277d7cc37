// Decisions drawn from a fuzzer's bytes.
#pragma once

#include <cstdint>
#include <span>

namespace voxelpipe::fuzz {

// Takes bytes from the front, zeros once they are spent.
class ByteSource {
 public:
  explicit ByteSource(std::span<const uint8_t> bytes) : bytes_(bytes) {}

  bool spent() const { return at_ >= bytes_.size(); }
  uint8_t Byte() { return spent() ? 0 : bytes_[at_++]; }
  // 0 <= result < count, count <= 256.
  int Below(int count) { return Byte() % count; }
  bool Chance(int one_in) { return Below(one_in) == one_in - 1; }
  // [-1, 1), a multiple of 2^-15.
  double Signed() {
    const int low = Byte(), high = Byte();
    return double(low + 256 * high) / 32768 - 1;
  }
  // [lo, hi).
  double Between(double lo, double hi) { return lo + (hi - lo) * (Signed() + 1) / 2; }

 private:
  std::span<const uint8_t> bytes_;
  size_t at_ = 0;
};

}  // namespace voxelpipe::fuzz
