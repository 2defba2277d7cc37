// Host code that lists bricks and gathers values from the dense data of a small sparse result.
#include "cuda/batch/batch_bricks.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>
#include <vector>

#include "pipeline/plan/plan.h"
#include "pipeline/stages/target_rules.h"

namespace voxelpipe::cuda {
namespace {

// Up to eight bits from bit `at` on, the first one lowest.
unsigned BitsAt(const uint8_t* bits, uint64_t at, int64_t count) {
  uint16_t two;
  std::memcpy(&two, bits + at / 8, sizeof two);
  return two >> (at % 8) & ((1u << count) - 1);
}

// Appends bits without gaps.
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

// Fills bricks and masks of `result` from the occupied voxels. Calls visit(index in the grid) for each, in result
// order. Returns their number.
template <typename Visit>
absl::StatusOr<uint64_t> ListBricks(const uint8_t* occupied, VoxelizeResult& result, const Visit& visit) {
  const auto [nx, ny, nz] = result.grid.dims;
  const int64_t bricks_x = (nx + 7) / 8, bricks_y = (ny + 7) / 8, bricks_z = (nz + 7) / 8;
  std::vector<uint64_t> ids;
  std::vector<std::array<uint8_t, 64>> masks;
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
            for (unsigned left = bits; left != 0; left &= left - 1) visit(at + unsigned(std::countr_zero(left)));
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
  return voxels;
}

bool BitAt(const uint8_t* bits, uint64_t at) {
  return (bits[at / 8] >> (at % 8) & 1) != 0;
}

// Gathers the elements of the listed voxels.
template <typename Element>
void Gather(const uint8_t* dense, const std::vector<uint64_t>& listed, uint64_t voxels, uint64_t components,
            bool planar, uint8_t* to) {
  const auto place = [&](uint64_t voxel, uint64_t of, uint64_t c) {
    return (planar ? c * of + voxel : voxel * components + c) * sizeof(Element);
  };
  for (uint64_t i = 0; i < listed.size(); ++i) {
    for (uint64_t c = 0; c < components; ++c) {
      std::memcpy(to + place(i, listed.size(), c), dense + place(listed[i], voxels, c), sizeof(Element));
    }
  }
}

}  // namespace

absl::Status BricksOfBits(const uint8_t* occupied, const uint8_t* covered, VoxelizeResult& result) {
  std::vector<bool> has_fragment;  // per listed voxel, if `covered` is not null
  const absl::StatusOr<uint64_t> voxels = ListBricks(occupied, result, [&](uint64_t n) {
    if (covered != nullptr) has_fragment.push_back(BitAt(covered, n));
  });
  if (!voxels.ok()) return voxels.status();
  for (const TargetSpec& spec : result.specs) {
    HostBuffer values;
    if (absl::Status s = Allocate((*voxels + 7) / 8, values); !s.ok()) return s;
    BitWriter writer(values);
    for (uint64_t i = 0; i < *voxels; ++i) writer.Append(covered == nullptr || has_fragment[i] || FillBit(spec));
    result.targets.push_back(std::move(values));
  }
  return absl::OkStatus();
}

absl::Status BricksOfDense(const uint8_t* occupied, const std::vector<const uint8_t*>& dense, VoxelizeResult& result) {
  std::vector<uint64_t> listed;
  const absl::StatusOr<uint64_t> count = ListBricks(occupied, result, [&](uint64_t n) { listed.push_back(n); });
  if (!count.ok()) return count.status();
  const bool planar = result.layout == Layout::kPlanar;
  for (size_t t = 0; t < result.specs.size(); ++t) {
    const TargetSpec& spec = result.specs[t];
    HostBuffer values;
    if (absl::Status s = Allocate(TargetBytes(spec, *count), values); !s.ok()) return s;
    const auto gather = [&]<typename Element>(Element) {
      Gather<Element>(dense[t], listed, result.grid.voxels(), uint64_t(spec.components), planar, values.data());
    };
    switch (BitsPerComponent(spec.format)) {
      case 1: {
        BitWriter writer(values);
        for (const uint64_t n : listed) writer.Append(BitAt(dense[t], n));
        break;
      }
      case 8: gather(uint8_t{}); break;
      case 16: gather(uint16_t{}); break;
      default: gather(uint32_t{}); break;
    }
    result.targets.push_back(std::move(values));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
