// Quantizes vertices to fixed-point index space, by one multiply-add per coordinate, with an error below two units; and
// computes the bounding box of voxels of a triangle from such vertices. The box is that of raster/triangle_setup.h
// unless a vertex lies within two units of a voxel border moved by the widening of narrow triangles (then it is marked
// as uncertain). No host-only includes.
#pragma once

#include "grid/index_space.h"
#include "raster/triangle_setup.h"

namespace voxelpipe {

// The transform from world space to fixed-point index space, and error bounds of the filter in its units.
struct FixedPlace {
  Vec3d scale, offset;
  int bits = 0;                    // fractional bits; 0: the mesh exceeds the range, fixed point cannot be used
  float widening = 0;              // widening of narrow triangles in units
  int margin = 0;                  // the same, rounded down to whole units
  float band = 0, plane_band = 0;  // half-width of the uncertain band of the edge tests and of the plane test, in units
  // A voxel in units; bound of the change of a normal by the quantization error, with a margin.
  float voxel = 0, noise = 0;
  float voxels = 0;  // a unit, in voxels
  int clear = 0;     // plane_band in whole units plus quantization error (FixedBox::beyond)
  int wall[3] = {INT32_MAX, INT32_MAX, INT32_MAX};  // as in IndexSpace
};

inline constexpr double kFixedMagic = 0x1.8p52;
inline constexpr float kCellBand = 1e-5f, kCellPlaneBand = 4e-5f;  // voxels

// `space`: the grid; `least`, `most`: the mesh's bounding box in its index space.
inline FixedPlace MakeFixedPlace(const IndexSpace& space, const Vec3d& least, const Vec3d& most) {
  const Vec3d &origin = space.origin, &voxel_size = space.voxel_size;
  FixedPlace place;
  const double reach = Max(MaxAbs(least), MaxAbs(most));
  const int bits = reach < 2000 ? 20 : reach < 4000 ? 19 : reach < 32000 ? 16 : 0;
  for (int i = 0; i < 3; ++i) {
    const double unit = 1 / voxel_size[i] * double(1 << bits);
    place.scale[i] = unit;
    place.offset[i] = kFixedMagic - origin[i] * unit;
    // Adding the magic number rounds the offset to whole units, with no further loss.
    if (!(Abs(origin[i] * unit) < 0x1p50 && unit < 0x1p900)) return place;
    if (!(space.wall[i] < IndexSpace::kNoWall)) continue;
    // The whole mesh must lie before the end of the wall: parts beyond it would have to be handled separately.
    if (most[i] > space.wall[i] || bits == 0) return place;
    place.wall[i] = int(space.wall[i] * double(1 << bits));
  }
  const auto unit = float(1 << bits);
  place.bits = bits;
  place.widening = float(kNarrowWidening) * unit;
  place.margin = int(place.widening);
  // Error bounds of raster/triangle_setup.h: about 17 x size x 2^-24 + 2^-19 for a size of 3 voxels here; and 2^-15 for
  // the plane of a sliver. Four units for the quantization, one of them for products of an edge and a position.
  place.band = kCellBand * unit + 4;
  place.plane_band = kCellPlaneBand * unit + 4;
  place.voxel = unit;
  place.noise = 0x1p-19f * unit * unit;
  place.voxels = 1 / unit;
  place.clear = int(place.plane_band) + 5;
  return place;
}

// `wall`: as in FixedPlace. A coordinate less than two units before the wall may be moved onto it, which only brings it
// nearer to its exact position.
VOXELPIPE_HD int ToFixed(double world, double scale, double offset, int wall) {
  const double sum = fma(world, scale, offset);
  uint64_t bits;
  memcpy(&bits, &sum, sizeof bits);
  return Min(int(uint32_t(bits)), wall);
}

// A vertex quantized relative to its mesh's bounding box: two thirds of the bytes, loaded in one access.
struct alignas(16) PackedVertex {
  uint32_t at[3];
  uint32_t triangle;  // the triangle that this corner belongs to
};

inline constexpr double kPackedParts = 4294967295.0;  // quantization steps along an axis of the box

// Length of a quantization step along an axis of finite length `extent`.
VOXELPIPE_HD double PartOf(double extent) {
  return extent > 0 ? extent / kPackedParts : 1;
}

// The nearest quantization step; positions outside the box are clamped.
VOXELPIPE_HD uint32_t PackCoordinate(double p, double least, double part) {
  return uint32_t(Clamp((p - least) / part + 0.5, 0.0, kPackedParts));
}

// The transform of packed vertices to fixed-point index space. Packing has an error of at most half a unit there; with
// rounding errors the total stays below two units, like that of ToFixed.
struct PackedPlace {
  Vec3d scale, offset;
};

// `place`, and the grid that it was made for; `least`, `extent`: the box of the packed vertices, which must be in the
// range of `place`.
inline PackedPlace MakePackedPlace(const FixedPlace& place, const Vec3d& origin, const Vec3d& voxel_size,
                                   const Vec3d& least, const Vec3d& extent) {
  PackedPlace packed;
  for (int i = 0; i < 3; ++i) {
    const double unit = 1 / voxel_size[i] * double(1 << place.bits);
    // A multiple of 2^-52, so that subtracting 2^52 steps is exact.
    const double part = extent[i] > 0 ? PartOf(extent[i]) * unit : 0;  // at most a unit, because the box is in range
    const auto all = double(int64_t(part * 0x1p52 + 0.5));
    packed.scale[i] = all * 0x1p-52;
    packed.offset[i] = (kFixedMagic - all) + (least[i] - origin[i]) * unit;
  }
  return packed;
}

VOXELPIPE_HD int PackedToFixed(uint32_t parts, double scale, double offset, int wall) {
  const uint64_t bits = uint64_t{0x43300000} << 32 | parts;  // the double 2^52 + parts
  double value;
  memcpy(&value, &bits, sizeof value);
  return ToFixed(value, scale, offset, wall);
}

// A triangle's bounding box of voxels, inclusive.
struct FixedBox {
  int first[3], last[3];
  bool doubtful;  // uncertain: a side may be off by one voxel
  int extent;     // length of its longest side, or a few units more
  // Minimum distance of its sides beyond the last voxel borders that they pass, or up to two units more.
  int beyond;
};

VOXELPIPE_HD FixedBox BoxOf(const int (&v)[3][3], const FixedPlace& place) {
  FixedBox box;
  const int below_voxel = (1 << place.bits) - 1;
  // Distances of the box's sides, moved up by two units, from the voxel border below.
  int from_least = below_voxel, from_most = 0, upto_least = below_voxel;
  box.extent = 0;
  for (int i = 0; i < 3; ++i) {
    const int from = Min(v[0][i], Min(v[1][i], v[2][i])) - (place.margin - 2);
    const int upto = Max(v[0][i], Max(v[1][i], v[2][i])) + (place.margin + 2);
    from_least = Min(from_least, from & below_voxel);
    from_most = Max(from_most, from & below_voxel);
    upto_least = Min(upto_least, upto & below_voxel);
    box.extent = Max(box.extent, upto - from);
    box.first[i] = from >> place.bits;
    box.last[i] = upto >> place.bits;
  }
  box.doubtful = Min(from_least, upto_least) < 4;
  box.beyond = Min(upto_least, below_voxel - from_most);
  return box;
}

}  // namespace voxelpipe
