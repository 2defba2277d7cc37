#include "encode/preview_colour.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "encode/preview_canvas.h"

namespace voxelpipe {
namespace {

// Nine even samples of matplotlib's viridis (N. Smith, S. van der Walt, 2015), which keeps its order in grey too.
Vec3f Viridis(float t) {
  static const std::array<Vec3f, 9> stops = {FromSrgb(0x440154), FromSrgb(0x472d7b), FromSrgb(0x3b528b),
                                             FromSrgb(0x2c728e), FromSrgb(0x21918c), FromSrgb(0x28ae80),
                                             FromSrgb(0x5ec962), FromSrgb(0xaddc30), FromSrgb(0xfde725)};
  const float position = std::clamp(t, 0.0f, 1.0f) * 8;
  const int index = std::min(7, int(position));
  return stops[size_t(index)] + (stops[size_t(index) + 1] - stops[size_t(index)]) * (position - float(index));
}

}  // namespace

PreviewColours::PreviewColours(const VoxelizeResult& result, const PreviewVolume& volume) {
  int chosen = -1;
  for (size_t i = 0; i < result.specs.size(); ++i) {
    if (result.specs[i].format != VoxelFormat::kF32) continue;
    if (result.specs[i].components >= 3) {
      chosen = int(i);
      break;
    }
    if (chosen < 0) chosen = int(i);
  }
  if (chosen < 0) return;
  const TargetSpec& spec = result.specs[size_t(chosen)];
  values_ = reinterpret_cast<const float*>(result.targets[size_t(chosen)].data());
  voxel_stride_ = result.layout == Layout::kPlanar ? 1 : uint64_t(spec.components);
  component_stride_ = result.layout == Layout::kPlanar ? result.grid.voxels() : 1;
  if (spec.components < 3) {
    FindRange(volume);
    if (low_ < high_) kind_ = Kind::kScalar;
  } else if (spec.shader.name == "normal" || spec.shader.name == "geometric_normal") {
    kind_ = Kind::kUnitVector;
  } else {
    kind_ = Kind::kLinearRgb;
  }
}

void PreviewColours::FindRange(const PreviewVolume& volume) {
  using Range = std::pair<float, float>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const auto& dims = volume.dims();
  const Range range = tbb::parallel_reduce(
      tbb::blocked_range<int64_t>(volume.lo()[2], std::max(volume.lo()[2], volume.hi()[2])),
      Range{kInfinity, -kInfinity},
      [&](const auto& slab, Range found) {
        for (int64_t k = slab.begin(); k < slab.end(); ++k) {
          for (int64_t j = 0; j < dims[1]; ++j) {
            for (int64_t i = 0; i < dims[0]; i += 32) {
              for (uint32_t word = volume.Row(i, j, k, 32); word != 0; word &= word - 1) {
                const float value = Value(volume.Linear(i + __builtin_ctz(word), j, k), 0);
                if (!std::isfinite(value)) continue;
                found = {std::min(found.first, value), std::max(found.second, value)};
              }
            }
          }
        }
        return found;
      },
      [](const Range& a, const Range& b) {
        return Range{std::min(a.first, b.first), std::max(a.second, b.second)};
      });
  low_ = range.first;
  high_ = range.second;
}

Vec3f PreviewColours::At(uint64_t n) const {
  static const Vec3f clay = FromSrgb(0x5f95c4);
  if (kind_ == Kind::kPlain) return clay;
  if (kind_ == Kind::kScalar) return Viridis((Value(n, 0) - low_) / (high_ - low_));
  Vec3f colour;
  for (int c = 0; c < 3; ++c) {
    float value = Value(n, c);
    if (kind_ == Kind::kUnitVector) {
      value = 0.5f + 0.5f * value;
      value *= value;  // the mapped normal is meant to be looked at as it is: near enough to undo the display's curve
    }
    colour[c] = value >= 0 ? std::min(value, 1.0f) : 0.0f;
  }
  return colour;
}

}  // namespace voxelpipe
