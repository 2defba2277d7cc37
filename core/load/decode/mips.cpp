#include "load/decode/mips.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "mesh/views/mips.h"
#include "shaders/texture/texture.h"

namespace voxelpipe {
namespace {

constexpr uint32_t kRows = 16;  // of a task

// The texels along one axis that texel i of the next level averages, and their weights.
struct Taps {
  uint32_t first = 0;
  int count = 1;
  double share[3] = {1, 0, 0};
};

Taps TapsOf(uint32_t i, uint32_t edge) {
  if (edge == 1) return {};
  if (edge % 2 == 0) return {2 * i, 2, {0.5, 0.5, 0}};
  // edge = 2m + 1 texels over m: each new texel covers 2 + 1/m old ones.
  const double n = edge, m = edge / 2;
  return {2 * i, 3, {(m - i) / n, m / n, (i + 1.0) / n}};
}

// `fetch(x, y)` reads the finer level.
template <typename FetchTexel>
void Halve(const JobContext& job, uint32_t width, uint32_t height, const FetchTexel& fetch, Vec4f* out) {
  const uint32_t w = LevelEdge(width, 1), h = LevelEdge(height, 1);
  tbb::parallel_for(tbb::blocked_range<uint32_t>(0, h, kRows), [&](const tbb::blocked_range<uint32_t>& rows) {
    for (uint32_t y = rows.begin(); y < rows.end(); ++y) {
      if (!job.Check().ok()) return;
      const Taps down = TapsOf(y, height);
      for (uint32_t x = 0; x < w; ++x) {
        const Taps across = TapsOf(x, width);
        double sum[4] = {0, 0, 0, 0};
        for (int j = 0; j < down.count; ++j) {
          for (int i = 0; i < across.count; ++i) {
            const Vec4f texel = fetch(across.first + uint32_t(i), down.first + uint32_t(j));
            const double share = across.share[i] * down.share[j];
            for (int c = 0; c < 4; ++c) sum[c] += share * double(texel[c]);
          }
        }
        out[uint64_t{y} * w + x] = {float(sum[0]), float(sum[1]), float(sum[2]), float(sum[3])};
      }
    }
  });
}

}  // namespace

absl::StatusOr<std::vector<Vec4f>> BuildMips(const JobContext& job, const uint8_t* rgba, uint32_t width,
                                             uint32_t height, bool srgb) {
  const uint32_t levels = CountLevels(width, height);
  const uint64_t size = LevelOffset(width, height, levels);
  std::vector<Vec4f> mips;
  mips.reserve(size);
  constexpr uint64_t kStep = 1 << 16;  // in steps, because writing fresh pages takes long
  while (mips.size() < size) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    mips.resize(std::min(size, mips.size() + kStep));
  }
  for (uint32_t level = 1; level < levels; ++level) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const uint32_t w = LevelEdge(width, level - 1), h = LevelEdge(height, level - 1);
    Vec4f* out = mips.data() + LevelOffset(width, height, level);
    if (level == 1) {
      Halve(
          job, w, h, [&](uint32_t x, uint32_t y) { return DecodeTexel(rgba + (uint64_t{y} * w + x) * 4, srgb); }, out);
    } else {
      const Vec4f* in = mips.data() + LevelOffset(width, height, level - 1);
      Halve(
          job, w, h, [&](uint32_t x, uint32_t y) { return in[uint64_t{y} * w + x]; }, out);
    }
  }
  if (absl::Status over = job.Check(); !over.ok()) return over;
  return mips;
}

}  // namespace voxelpipe
