#include "encode/preview/preview_colour.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "encode/preview/preview_canvas.h"
#include "shaders/fragment/packed_normal.h"
#include "shaders/texture/srgb.h"

namespace voxelpipe {
namespace {

// Nine even samples of matplotlib's viridis (N. Smith, S. van der Walt, 2015), which is monotonic in brightness.
Vec3f Viridis(float t) {
  static const std::array<Vec3f, 9> stops = {FromSrgb(0x440154), FromSrgb(0x472d7b), FromSrgb(0x3b528b),
                                             FromSrgb(0x2c728e), FromSrgb(0x21918c), FromSrgb(0x28ae80),
                                             FromSrgb(0x5ec962), FromSrgb(0xaddc30), FromSrgb(0xfde725)};
  const float position = std::clamp(t, 0.0f, 1.0f) * 8;
  const int index = std::min(7, int(position));
  return stops[size_t(index)] + (stops[size_t(index) + 1] - stops[size_t(index)]) * (position - float(index));
}

// Sums, counts and bitwise blends of packed normals are no normals.
bool HoldsPackedNormals(const TargetSpec& spec, ResultKind kind) {
  if (spec.shader.name != "packed_normal" || spec.components != 1) return false;
  if (spec.format != VoxelFormat::kU16 && spec.format != VoxelFormat::kU32 && spec.format != VoxelFormat::kF32) {
    return false;
  }
  return kind == ResultKind::kBuckets || spec.blend == Blend::kReplace || spec.blend == Blend::kFirst ||
         spec.blend == Blend::kMin || spec.blend == Blend::kMax;
}

}  // namespace

float ColourUnit(const TargetSpec& spec) {
  switch (spec.format) {
    case VoxelFormat::kU8: return float(spec.scale.value_or(255));
    case VoxelFormat::kU16: return float(spec.scale.value_or(65535));
    case VoxelFormat::kU32: return float(spec.scale.value_or(0));
    default: return 1;
  }
}

Vec3f InsideColour() {
  static const Vec3f colour = FromSrgb(0xb4c2d0);
  return colour;
}

PreviewColours::PreviewColours(const VoxelizeResult& result, const PreviewVolume& volume, const JobContext* job)
    : volume_(volume), items_(result) {
  int chosen = -1;
  for (size_t i = 0; i < result.specs.size(); ++i) {
    const TargetSpec& spec = result.specs[i];
    if (spec.format == VoxelFormat::kBit) continue;
    if (HoldsPackedNormals(spec, result.kind)) {
      if (!has_normals_) normals_ = TargetValues(result, i, items_.count());
      has_normals_ = true;
      continue;
    }
    if (spec.components >= 3 && ColourUnit(spec) > 0) {
      chosen = int(i);
      break;
    }
    if (chosen < 0) chosen = int(i);
  }
  if (chosen < 0) {
    if (result.kind != ResultKind::kBuckets || has_normals_) return;
    high_ = std::log2(float(std::max<uint64_t>(1, items_.MaxFragments())));
    if (high_ > 0) kind_ = Kind::kFragments;
    return;
  }
  const TargetSpec& spec = result.specs[size_t(chosen)];
  values_ = TargetValues(result, size_t(chosen), items_.count());
  unit_ = ColourUnit(spec);
  components_ = spec.components;
  const uint32_t cell = NumberToCell(spec.clear, spec.format);
  clear_ = IsInteger(spec.format) ? float(cell) : FloatOf(cell);
  encoding_ = spec.encoding;
  words_ = spec.format == VoxelFormat::kU32;
  if (HoldsLabels(spec, result.kind) && !result.parts.empty()) {
    legend_ = LegendOf(result.parts);
    kind_ = Kind::kLabels;
  } else if (spec.components < 3 || !(unit_ > 0)) {
    FindRange(result, job);
    if (low_ < high_) kind_ = Kind::kScalar;
  } else if (spec.shader.name == "velocity") {
    kind_ = Kind::kLength;
    FindRange(result, job);
    if (!(low_ < high_)) kind_ = Kind::kPlain;
  } else if (spec.shader.name == "normal" || spec.shader.name == "geometric_normal" || encoding_ == Encoding::kSnorm) {
    kind_ = Kind::kUnitVector;
  } else {
    kind_ = Kind::kLinearRgb;
  }
}

uint64_t PreviewColours::MemoryBytes(const VoxelizeResult& result) {
  return PreviewItems::MemoryBytes(result) + LegendBytes(result.parts.shape());
}

Vec3f PreviewColours::ColourOfLabel(uint64_t item) const {
  static const Vec3f other = FromSrgb(0xc9c3b8);  // of a number that is no part's label
  const uint32_t label = words_ ? values_.WordAt(item, 0) : uint32_t(std::max(values_.At(item, 0), 0.0f));
  const auto found = std::lower_bound(legend_.begin(), legend_.end(), label,
                                      [](const LegendEntry& entry, uint32_t l) { return entry.label < l; });
  return found != legend_.end() && found->label == label ? FromSrgb(found->rgb) : other;
}

void PreviewColours::FindRange(const VoxelizeResult& result, const JobContext* job) {
  using Range = std::pair<float, float>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const auto include = [this](Range& found, uint64_t item) {
    const float value = NumberOf(item);
    if (std::isfinite(value) && !IsClear(item)) found = {std::min(found.first, value), std::max(found.second, value)};
  };
  const auto join = [](const Range& a, const Range& b) {
    return Range{std::min(a.first, b.first), std::max(a.second, b.second)};
  };
  Range range{kInfinity, -kInfinity};
  if (result.kind == ResultKind::kDense) {
    range = tbb::parallel_reduce(
        tbb::blocked_range<int64_t>(0, volume_.layers()), range,
        [&](const auto& layers, Range found) {
          if (!CheckJob(job).ok()) return found;
          JobPoll poll(job);
          for (int64_t layer = layers.begin(); layer < layers.end(); ++layer) {
            const int64_t k = volume_.Layer(layer);
            const absl::Status s = volume_.VisitRows(k, poll, [&](int64_t i, int64_t j, uint32_t word) {
              for (; word != 0; word &= word - 1) include(found, volume_.Linear(i + std::countr_zero(word), j, k));
            });
            if (!s.ok()) break;
          }
          return found;
        },
        join);
  } else {  // draws the listed voxels
    range = tbb::parallel_reduce(
        tbb::blocked_range<uint64_t>(0, items_.count(), 1 << 14), range,
        [&](const auto& part, Range found) {
          if (!CheckJob(job).ok()) return found;
          for (uint64_t item = part.begin(); item < part.end(); ++item) include(found, item);
          return found;
        },
        join);
  }
  low_ = range.first;
  high_ = range.second;
}

float PreviewColours::NumberOf(uint64_t item) const {
  if (kind_ != Kind::kLength) return values_.At(item, 0);
  float squares = 0;
  for (int c = 0; c < 3; ++c) squares += values_.At(item, c) * values_.At(item, c);
  return std::sqrt(squares);
}

bool PreviewColours::IsClear(uint64_t item) const {
  for (int c = 0; c < components_; ++c) {
    if (values_.At(item, c) != clear_) return false;
  }
  return true;
}

Vec3f PreviewColours::At(uint64_t n) const {
  static const Vec3f clay = FromSrgb(0x5f95c4), pale = FromSrgb(0xc9c3b8);
  // A pale surface shows normals best by its shading.
  if (kind_ == Kind::kPlain) return has_normals_ ? pale : clay;
  if (kind_ == Kind::kFragments) return Viridis(std::log2(float(items_.FragmentsOf(n))) / high_);
  const uint64_t item = items_.Find(n);
  if (item == PreviewItems::kNone) return clay;
  if (IsClear(item) && volume_.Enclosed(n)) return InsideColour();
  if (kind_ == Kind::kLabels) return ColourOfLabel(item);
  if (kind_ == Kind::kScalar || kind_ == Kind::kLength) return Viridis((NumberOf(item) - low_) / (high_ - low_));
  Vec3f colour;
  for (int c = 0; c < 3; ++c) {
    float value = values_.At(item, c) / unit_;
    if (encoding_ == Encoding::kSrgb) value = SrgbToLinear(static_cast<unsigned char>(values_.At(item, c)));
    if (kind_ == Kind::kUnitVector) {
      if (encoding_ != Encoding::kSnorm) value = 0.5f + 0.5f * value;
      value *= value;  // mapped normals are display values: approximately undoes the display's transfer function
    }
    colour[c] = value >= 0 ? std::min(value, 1.0f) : 0.0f;
  }
  return colour;
}

std::optional<Vec3f> PreviewColours::NormalAt(uint64_t n) const {
  if (!has_normals_) return std::nullopt;
  const uint64_t item = items_.Find(n);
  if (item == PreviewItems::kNone) return std::nullopt;
  const float packed = normals_.At(item, 0);
  if (!(packed >= 0 && packed <= 65535)) return std::nullopt;
  return UnpackNormal(uint32_t(packed));
}

}  // namespace voxelpipe
