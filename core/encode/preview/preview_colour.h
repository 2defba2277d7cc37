// The colour of a voxel in the preview, and the normal it is lit with.
#pragma once

#include <cstdint>
#include <optional>

#include "base/vec.h"
#include "encode/preview/legend.h"
#include "encode/preview/preview_values.h"
#include "encode/preview/preview_volume.h"
#include "job/result.h"

namespace voxelpipe {

// The stored value of 1 of a colour; 0 if integers hold no colour.
float ColourUnit(const TargetSpec& spec);

// The colour of the inside of a solid, linear RGB.
Vec3f InsideColour();

// The rules are at RenderPreview. Borrows the result and the volume, which must outlive it.
class PreviewColours {
 public:
  // `job` may be null. At its end the constructor returns early, with colours that mean nothing: look at the job next.
  PreviewColours(const VoxelizeResult& result, const PreviewVolume& volume, const JobContext* job = nullptr);
  // What the constructor allocates.
  static uint64_t MemoryBytes(const VoxelizeResult& result);

  // Linear RGB in [0, 1] of solid voxel n of the linear order. InsideColour() for a voxel inside a solid (all
  // neighbours in the grid are solid) that holds `clear`, as fills leave it for shaders that need a triangle.
  Vec3f At(uint64_t n) const;
  // True if voxels have colours of their own, not one for all.
  bool has_colours() const { return kind_ != Kind::kPlain; }
  // Where voxels have the colours of labels: these. Otherwise empty.
  const std::vector<LegendEntry>& legend() const { return legend_; }
  // True if the result has normals for lighting.
  bool has_normals() const { return has_normals_; }
  // The unit normal stored for voxel n, world axes; empty if it has none.
  std::optional<Vec3f> NormalAt(uint64_t n) const;
  const PreviewItems& items() const { return items_; }

 private:
  enum class Kind { kPlain, kLinearRgb, kUnitVector, kScalar, kLength, kFragments, kLabels };

  // The number of an item that a colour map shows: the first component, or the length.
  float NumberOf(uint64_t item) const;
  // True if the chosen target holds `clear` in every component of the item.
  bool IsClear(uint64_t item) const;
  void FindRange(const VoxelizeResult& result, const JobContext* job);
  Vec3f ColourOfLabel(uint64_t item) const;

  const PreviewVolume& volume_;
  PreviewItems items_;
  Kind kind_ = Kind::kPlain;
  std::vector<LegendEntry> legend_;
  TargetValues values_, normals_;
  bool has_normals_ = false;
  float unit_ = 1;  // the stored value of 1 of a colour
  Encoding encoding_ = Encoding::kLinear;
  bool words_ = false;        // `values_` are u32, of which floats hold not all
  int components_ = 1;        // of `values_`
  float clear_ = 0;           // the stored value of voxels without fragments
  float low_ = 0, high_ = 0;  // range of NumberOf over the solid voxels that are not clear; of kFragments, logarithms
};

}  // namespace voxelpipe
