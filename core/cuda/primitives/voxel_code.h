// Encodes which voxels a vertex touches in 8 bytes, so that a triangle's bounding box of voxels takes integer
// operations only.
//
// FirstVoxel and LastVoxel (raster/triangle_setup.h) are monotonic, so the box of a triangle runs from the minimum
// first voxel to the maximum last voxel of its vertices. The code of an axis is 4 * floor(v) + s, with s = 0 if the
// vertex also touches the previous voxel, 2 if it also touches the next one, 1 if neither. Codes are monotonic in v, so
// the minimum and maximum code of the vertices give both ends.
#pragma once

#include "raster/triangle_setup.h"

namespace voxelpipe::cuda {

struct alignas(8) VertexCode {
  int16_t axis[3];
  int16_t far;  // not 0: out of the range of codes; `axis` is undefined
};

inline constexpr int kMinCell = -8, kMaxCell = 8180;  // floor(v) of encodable vertices

// `v`: in index space. Valid for conservative and thin coverage; the box of center coverage is smaller.
VOXELPIPE_HD VertexCode EncodeVertex(const Vec3d& v) {
  VertexCode code{};
  for (int i = 0; i < 3; ++i) {
    const double cell = floor(v[i]);
    if (!(cell >= double(kMinCell) && cell <= double(kMaxCell))) {
      code.far = 1;
      continue;
    }
    const bool before = setup_internal::FirstVoxel(v[i], 0.5, kNarrowWidening) < cell;
    const bool behind = setup_internal::LastVoxel(v[i], 0.5, kNarrowWidening) > cell;
    code.axis[i] = int16_t(4 * int(cell) + (before ? 0 : behind ? 2 : 1));
  }
  return code;
}

// A triangle's box of voxels, inclusive, identical to that of SetUpTriangle for conservative and thin coverage, and the
// floor of its minimum corner.
struct CodedBox {
  int first[3], last[3], base[3];
  bool far;  // some vertex is out of range: the rest is undefined
};

VOXELPIPE_HD CodedBox DecodeBox(const VertexCode& a, const VertexCode& b, const VertexCode& c) {
  CodedBox box;
  box.far = (a.far | b.far | c.far) != 0;
  for (int i = 0; i < 3; ++i) {
    const int least = Min(int(a.axis[i]), Min(int(b.axis[i]), int(c.axis[i])));
    const int most = Max(int(a.axis[i]), Max(int(b.axis[i]), int(c.axis[i])));
    box.base[i] = least >> 2;
    box.first[i] = box.base[i] - ((least & 3) == 0);
    box.last[i] = (most >> 2) + ((most & 3) == 2);
  }
  return box;
}

}  // namespace voxelpipe::cuda
