// A tile's buffer against blend_ops.h, fragment by fragment.
#include "cpu/tile_buffer.h"

#include <cmath>
#include <limits>
#include <optional>
#include <random>

#include "gtest/gtest.h"

namespace voxelpipe::cpu {
namespace {

FragmentOutput RandomOutput(std::mt19937& random) {
  static const float kSpecial[] = {0.0f, -0.0f, INFINITY, -INFINITY, NAN, 1e-40f, -1e-40f, 3e38f, 65519.0f, 0.5f};
  FragmentOutput out;
  for (int c = 0; c < 4; ++c) {
    const uint32_t bits = uint32_t(random());
    out.f[c] = random() % 2 != 0 ? kSpecial[random() % std::size(kSpecial)] : float(int32_t(bits)) * 0x1p-24f;
    out.u[c] = random() % 4 == 0 ? bits : bits % 300;
  }
  return out;
}

// One component of one voxel, as blend_ops.h says.
struct Reference {
  std::optional<uint32_t> cell;
  int64_t sum = 0;
  uint32_t count = 0;

  void Add(const CpuTarget& target, const FragmentOutput& out, int c) {
    const TargetSpec& spec = target.spec;
    ++count;
    if (spec.format == VoxelFormat::kBit) {
      const bool v = spec.blend == Blend::kCount || ToBit(out, target.u32_output);
      cell = cell ? BlendBit(spec.blend, *cell != 0, v) : v;
      return;
    }
    sum += ToTerm(out, target.u32_output, c, spec.format, target.scale, spec.quantum);
    const uint32_t v = ToCell(out, target.u32_output, c, spec.format, target.scale);
    const bool is_float = !IsInteger(spec.format);
    cell = cell ? BlendCell(spec.blend, is_float, *cell, v) : v;
  }

  uint32_t Stored(const TargetSpec& spec) const {
    if (spec.format == VoxelFormat::kBit) return *cell;
    if (spec.blend == Blend::kCount) return StoreCount(count, spec.format);
    if (spec.blend == Blend::kAdd) return StoreSum(sum, spec.format, spec.quantum);
    if (spec.blend == Blend::kAverage) return StoreAverage(sum, count, spec.format, spec.quantum);
    return StoredBits(*cell, spec.format);
  }
};

// Two tiles one after the other, so that nothing of the first may show in the second.
void ExpectTheReference(const CpuTarget& target, uint32_t seed) {
  std::mt19937 random(seed);
  const int components = target.spec.components;
  TileBuffer buffer(target);
  for (int tile = 0; tile < 2; ++tile) {
    std::vector<std::array<Reference, 4>> voxels(kTileVoxels);
    buffer.Begin();
    for (int i = 0; i < 400; ++i) {
      const int row = int(random() % 40), a = int(random() % 32), b = int(random() % 32);
      const TileSpan span = TileSpan::At(row, std::min(a, b), std::max(a, b));
      const FragmentOutput out = RandomOutput(random);
      buffer.Blend(span, buffer.Convert(out), 0);
      for (int x = span.first(); x <= span.last(); ++x) {
        for (int c = 0; c < components; ++c) voxels[size_t(row * 32 + x)][size_t(c)].Add(target, out, c);
      }
    }
    for (int row = 0; row < kTileRows; ++row) {
      for (int x = 0; x < 32; ++x) {
        const std::array<Reference, 4>& voxel = voxels[size_t(row * 32 + x)];
        ASSERT_EQ(buffer.presence(row) >> x & 1, uint32_t(voxel[0].count > 0));
      }
      for (int c = 0; c < components; ++c) {
        uint32_t stored[32];
        buffer.StoredRow(row, c, buffer.presence(row), stored);
        for (int x = 0; x < 32; ++x) {
          if ((buffer.presence(row) >> x & 1) == 0) continue;
          const uint64_t mask = (uint64_t{1} << BitsPerComponent(target.spec.format)) - 1;
          ASSERT_EQ(stored[x] & mask, voxels[size_t(row * 32 + x)][size_t(c)].Stored(target.spec) & mask)
              << Name(target.spec.format) << " " << Name(target.spec.blend) << ", u32 " << target.u32_output
              << ", component " << c;
        }
      }
    }
  }
}

TEST(TileBuffer, BlendsEveryFormatAsTheOperationsDoFragmentByFragment) {
  uint32_t seed = 1;
  for (int format = 0; format <= int(VoxelFormat::kF32); ++format) {
    for (int blend = 0; blend <= int(Blend::kAnd); ++blend) {
      if (!CheckBlend(VoxelFormat(format), Blend(blend)).ok()) continue;
      for (const bool u32_output : {false, true}) {
        CpuTarget target;
        target.spec.format = VoxelFormat(format);
        target.spec.blend = Blend(blend);
        target.spec.components = format == int(VoxelFormat::kBit) ? 1 : 1 + int(seed % 4);
        target.kept_format = target.spec.format;
        target.scale = u32_output ? 1 : 255;
        target.u32_output = u32_output;
        ExpectTheReference(target, seed++);
      }
    }
  }
}

}  // namespace
}  // namespace voxelpipe::cpu
