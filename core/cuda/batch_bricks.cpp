#include "cuda/batch_bricks.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>
#include <vector>

namespace voxelpipe::cuda {
namespace {

// Up to eight bits from bit `at` on, the first lowest.
unsigned BitsAt(const uint8_t* bits, uint64_t at, int64_t count) {
  uint16_t two;
  std::memcpy(&two, bits + at / 8, sizeof two);
  return two >> (at % 8) & ((1u << count) - 1);
}

// Appends bits end to end.
class BitWriter {
 public:
  explicit BitWriter(HostBuffer& to) : to_(to.data()) { std::fill_n(to_, to.size(), uint8_t{0}); }
  void Append(bool bit) {
    to_[at_ / 8] = uint8_t(to_[at_ / 8] | unsigned(bit) << (at_ % 8));
    ++at_;
  }

 private:
  uint8_t* to_;
  uint64_t at_ = 0;
};

absl::Status Allocate(uint64_t bytes, HostBuffer& to) {
  absl::StatusOr<HostBuffer> allocated = HostBuffer::Allocate(bytes);
  if (!allocated.ok()) return allocated.status();
  to = *std::move(allocated);
  return absl::OkStatus();
}

}  // namespace

absl::Status BricksOfBits(const uint8_t* occupied, const uint8_t* covered, VoxelizeResult& result) {
  const auto [nx, ny, nz] = result.grid.dims;
  const int64_t bricks_x = (nx + 7) / 8, bricks_y = (ny + 7) / 8, bricks_z = (nz + 7) / 8;
  std::vector<uint64_t> ids;
  std::vector<std::array<uint8_t, 64>> masks;
  std::vector<bool> has_fragment;  // of the listed voxels, in their order; where `covered` is given
  uint64_t voxels = 0;
  for (int64_t bz = 0; bz < bricks_z; ++bz) {
    for (int64_t by = 0; by < bricks_y; ++by) {
      for (int64_t bx = 0; bx < bricks_x; ++bx) {
        std::array<uint8_t, 64> mask{};
        uint64_t here = 0;
        const int64_t width = std::min<int64_t>(8, nx - 8 * bx);
        const int64_t z_end = std::min(nz, 8 * bz + 8), y_end = std::min(ny, 8 * by + 8);
        for (int64_t z = 8 * bz; z < z_end; ++z) {
          for (int64_t y = 8 * by; y < y_end; ++y) {
            const uint64_t at = uint64_t(8 * bx + nx * (y + ny * z));
            const unsigned bits = BitsAt(occupied, at, width);
            mask[size_t(y - 8 * by + 8 * (z - 8 * bz))] = uint8_t(bits);
            here += unsigned(std::popcount(bits));
            if (covered == nullptr || bits == 0) continue;
            const unsigned fragments = BitsAt(covered, at, width);
            for (unsigned left = bits; left != 0; left &= left - 1) {
              has_fragment.push_back((fragments & left & -left) != 0);
            }
          }
        }
        if (here == 0) continue;
        ids.push_back(uint64_t(bx + bricks_x * (by + bricks_y * bz)));
        masks.push_back(mask);
        voxels += here;
      }
    }
  }
  if (absl::Status s = Allocate(ids.size() * sizeof(uint64_t), result.bricks); !s.ok()) return s;
  if (absl::Status s = Allocate(masks.size() * 64, result.masks); !s.ok()) return s;
  if (!ids.empty()) {
    std::memcpy(result.bricks.data(), ids.data(), result.bricks.size());
    std::memcpy(result.masks.data(), masks.data(), result.masks.size());
  }
  for (const TargetSpec& spec : result.specs) {
    HostBuffer values;
    if (absl::Status s = Allocate((voxels + 7) / 8, values); !s.ok()) return s;
    BitWriter writer(values);
    for (uint64_t i = 0; i < voxels; ++i) writer.Append(covered == nullptr || has_fragment[i] || spec.fill_value != 0);
    result.targets.push_back(std::move(values));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
