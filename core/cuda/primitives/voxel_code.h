// The voxels about a vertex in 8 bytes: enough to find a triangle's box of voxels by integer operations alone.
//
// FirstVoxel and LastVoxel (raster/triangle_setup.h) grow with their coordinate, so the box of a triangle is the least
// first and the greatest last of its vertices. Per axis a code is 4 * floor(v) + s, where s is 0 if the vertex touches
// the voxel before too, 2 if it touches the one behind, 1 if neither: codes grow with v, so the least and the largest
// code of the vertices tell both.
#pragma once

#include "raster/triangle_setup.h"

namespace voxelpipe::cuda {

struct alignas(8) VertexCode {
  int16_t axis[3];
  int16_t far;  // not 0: farther out than codes reach, which are not set
};

inline constexpr int kMinCell = -8, kMaxCell = 8180;  // floor(v) of vertices that have codes

// In: index space. Conservative and thin; the box of center coverage is smaller.
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

// A triangle's box of voxels, inclusive, as SetUpTriangle has it under conservative and thin, and the floor of its
// least corner.
struct CodedBox {
  int first[3], last[3], base[3];
  bool far;  // some vertex has no code: the rest is undefined
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
