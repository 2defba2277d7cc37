// Vertices as fixed-point integers of index space, one multiply-add a coordinate, which is off by less than two units;
// and the box of voxels that a triangle of such reaches: that of raster/triangle_setup.h unless a vertex lies within
// two units of a voxel's border moved by the widening of narrow triangles. No host-only includes.
#pragma once

#include "grid/index_space.h"
#include "raster/triangle_setup.h"

namespace voxelpipe {

// World space to fixed-point index space.
struct FixedPlace {
  Vec3d scale, offset;
  int bits = 0;                    // after the point; 0: the mesh reaches too far, there are none
  float widening = 0;              // voxel sizes in units
  int margin = 0;                  // the same in whole units
  float band = 0, plane_band = 0;  // likewise, of the tests of edges and of the plane
  float voxel = 0, noise = 0;      // a voxel; what moving vertices by units does to a normal, at most, and some more
  float voxels = 0;                // a unit, in voxels
  int clear = 0;                   // plane_band in whole units, and some for the fixed point (FixedBox::beyond)
  int wall[3] = {INT32_MAX, INT32_MAX, INT32_MAX};  // IndexSpace's
};

inline constexpr double kFixedMagic = 0x1.8p52;
inline constexpr float kCellBand = 1e-5f, kCellPlaneBand = 4e-5f;  // voxels

// In: where the grid lies, the mesh's box in its index space.
inline FixedPlace MakeFixedPlace(const IndexSpace& space, const Vec3d& least, const Vec3d& most) {
  const Vec3d &origin = space.origin, &voxel_size = space.voxel_size;
  FixedPlace place;
  const double reach = Max(MaxAbs(least), MaxAbs(most));
  const int bits = reach < 2000 ? 20 : reach < 4000 ? 19 : reach < 32000 ? 16 : 0;
  for (int i = 0; i < 3; ++i) {
    const double unit = 1 / voxel_size[i] * double(1 << bits);
    place.scale[i] = unit;
    place.offset[i] = kFixedMagic - origin[i] * unit;
    // The offset loses what lies below a unit, and no more.
    if (!(Abs(origin[i] * unit) < 0x1p50 && unit < 0x1p900)) return place;
    if (!(space.wall[i] < IndexSpace::kNoWall)) continue;
    // The whole mesh lies before the end of the wall, or all of it that is beyond the wall would have to be told apart.
    if (most[i] > space.wall[i] || bits == 0) return place;
    place.wall[i] = int(space.wall[i] * double(1 << bits));
  }
  const auto unit = float(1 << bits);
  place.bits = bits;
  place.widening = float(kNarrowWidening) * unit;
  place.margin = int(place.widening);
  // raster/triangle_setup.h: some 17 x size x 2^-24 + 2^-19 for a size of 3 voxels here; and 2^-15 for the plane of a
  // sliver. Four units for the fixed point, one of them for products of an edge and a position.
  place.band = kCellBand * unit + 4;
  place.plane_band = kCellPlaneBand * unit + 4;
  place.voxel = unit;
  place.noise = 0x1p-19f * unit * unit;
  place.voxels = 1 / unit;
  place.clear = int(place.plane_band) + 5;
  return place;
}

// `wall`: as in FixedPlace. What lies less than two units before it may come to lie on it, which is as much nearer to
// where it belongs.
VOXELPIPE_HD int ToFixed(double world, double scale, double offset, int wall) {
  const double sum = fma(world, scale, offset);
  uint64_t bits;
  memcpy(&bits, &sum, sizeof bits);
  return Min(int(uint32_t(bits)), wall);
}

// A vertex as parts of its mesh's box, counted from the least corner: two thirds of the bytes, in one access of memory.
struct alignas(16) PackedVertex {
  uint32_t at[3];
  uint32_t triangle;  // whose corner it is
};

inline constexpr double kPackedParts = 4294967295.0;  // of the box along an axis

// How long a part is of an axis along which the box is `extent` long, which is finite.
VOXELPIPE_HD double PartOf(double extent) {
  return extent > 0 ? extent / kPackedParts : 1;
}

// The nearest part; of what lies outside of the box, the first or the last.
VOXELPIPE_HD uint32_t PackCoordinate(double p, double least, double part) {
  return uint32_t(Clamp((p - least) / part + 0.5, 0.0, kPackedParts));
}

// Packed vertices to fixed-point index space. The nearest part is off by half a unit at most there, and with what is
// rounded on the way the result is off by less than two, as that of ToFixed.
struct PackedPlace {
  Vec3d scale, offset;
};

// In: a place, what it was made from, and the least corner and the extent of the packed box, which `place` reaches.
inline PackedPlace MakePackedPlace(const FixedPlace& place, const Vec3d& origin, const Vec3d& voxel_size,
                                   const Vec3d& least, const Vec3d& extent) {
  PackedPlace packed;
  for (int i = 0; i < 3; ++i) {
    const double unit = 1 / voxel_size[i] * double(1 << place.bits);
    // A whole multiple of 2^-52, so that what 2^52 of it make is taken off without rounding.
    const double part = extent[i] > 0 ? PartOf(extent[i]) * unit : 0;  // at most a unit: `place` reaches the box
    const auto all = double(int64_t(part * 0x1p52 + 0.5));
    packed.scale[i] = all * 0x1p-52;
    packed.offset[i] = (kFixedMagic - all) + (least[i] - origin[i]) * unit;
  }
  return packed;
}

VOXELPIPE_HD int PackedToFixed(uint32_t parts, double scale, double offset, int wall) {
  const uint64_t bits = uint64_t{0x43300000} << 32 | parts;  // 2^52 and the parts
  double value;
  memcpy(&value, &bits, sizeof value);
  return ToFixed(value, scale, offset, wall);
}

// Of a triangle: its box of voxels, inclusive.
struct FixedBox {
  int first[3], last[3];
  bool doubtful;  // one voxel more or less on some side
  int extent;     // of its longest side, or some units more
  int beyond;     // how far its sides lie beyond the last borders of voxels that they pass, at least, or two units more
};

VOXELPIPE_HD FixedBox BoxOf(const int (&v)[3][3], const FixedPlace& place) {
  FixedBox box;
  const int below_voxel = (1 << place.bits) - 1;
  // How far the box's sides, moved up by two units, lie behind a voxel's border.
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
