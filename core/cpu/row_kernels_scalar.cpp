// The kernels in plain C++: what the vector kernels repeat lane by lane, and the choice among all.
#include <hwy/targets.h>

#include "absl/strings/str_cat.h"
#include "cpu/row_kernels_simd.h"
#include "grid/index_space.h"

namespace voxelpipe::cpu {
namespace {

constexpr double kFarthest = 0x1p40;  // voxels

int16_t Code(double p) {
  const double first = setup_internal::FirstVoxel(p, 0.5, kNarrowWidening);
  const double last = setup_internal::LastVoxel(p, 0.5, kNarrowWidening);
  return int16_t(Clamp(first + last, -32768.0, 32767.0));  // last - first is 0 or 1
}

bool Bounds(const Vec3d* world, int64_t begin, int64_t end, Vec3d& least, Vec3d& most) {
  least = most = world[begin];
  bool finite = true;
  for (int64_t i = begin; i < end; ++i) {
    for (int a = 0; a < 3; ++a) {
      finite = finite && Abs(world[i][a]) < HUGE_VAL;  // false for NaN
      least[a] = Min(least[a], world[i][a]);
      most[a] = Max(most[a], world[i][a]);
    }
  }
  return finite;
}

bool Place(const Vec3d* world, int64_t begin, int64_t end, const Vec3d& origin, const Vec3d& voxel_size, Vec3d* index,
           VertexCode* codes) {
  bool near = true;
  for (int64_t i = begin; i < end; ++i) {
    const Vec3d p = WorldToIndex(origin, voxel_size, world[i]);
    index[i] = p;
    near = near && Abs(p.x) <= kFarthest && Abs(p.y) <= kFarthest && Abs(p.z) <= kFarthest;
    codes[i] = {{Code(p.x), Code(p.y), Code(p.z), 0}};
  }
  return near;
}

RowClass Classify(const TriangleBox& box, const int64_t (&dims)[3], Coverage coverage) {
  int single = 0;
  for (int a = 0; a < 3; ++a) {
    if (box.last[a] < 0 || box.first[a] >= dims[a]) return RowClass::kOutside;
    single += box.first[a] == box.last[a];
  }
  if (coverage == Coverage::kConservative && single >= 2) return RowClass::kRun;
  return box.last[1] - box.first[1] < kSmallRows && box.last[2] - box.first[2] < kSmallRows ? RowClass::kSmall
                                                                                            : RowClass::kLarge;
}

void ClassifyAll(const uint32_t (*triangles)[3], const VertexCode* codes, int64_t begin, int64_t end,
                 const int64_t (&dims)[3], Coverage coverage, TriangleBox* boxes) {
  for (int64_t t = begin; t < end; ++t) {
    const int16_t *a = codes[triangles[t][0]].axis, *b = codes[triangles[t][1]].axis, *c = codes[triangles[t][2]].axis;
    TriangleBox box{};
    for (int i = 0; i < 3; ++i) {
      box.first[i] = int16_t(Min(a[i], Min(b[i], c[i])) >> 1);
      box.last[i] = int16_t((Max(a[i], Max(b[i], c[i])) + 1) >> 1);
    }
    box.row_class = int16_t(Classify(box, dims, coverage));
    boxes[t - begin] = box;
  }
}

void Raster(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage, const RowSlab& slab) {
  const VoxelRange range{{0, 0, slab.begin}, {slab.nx, slab.ny, slab.end}};
  for (int64_t i = 0; i < count; ++i) {
    const uint32_t* v = mesh.triangles[ids[i]];
    const TriangleSetup setup =
        SetUpTriangle(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], coverage);
    ForEachRowSpan(setup, range, [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
      SetBits(slab.words + (y + slab.ny * (z - slab.begin)) * slab.words_per_row, x_begin, x_end);
    });
  }
}

const RowKernels kScalar{"scalar", Bounds, Place, ClassifyAll, Raster, Raster};

}  // namespace

absl::StatusOr<const RowKernels*> SelectRowKernels(SimdChoice choice) {
  const auto has = [](int64_t target) { return (hwy::SupportedTargets() & target) != 0; };
  const bool avx512 = has(HWY_AVX3) && Avx512RowKernels() != nullptr;
  const bool avx2 = has(HWY_AVX2) && Avx2RowKernels() != nullptr;
  switch (choice) {
    case SimdChoice::kAuto: return avx512 ? Avx512RowKernels() : avx2 ? Avx2RowKernels() : &kScalar;
    case SimdChoice::kScalar: return &kScalar;
    case SimdChoice::kAvx2:
      if (avx2) return Avx2RowKernels();
      break;
    case SimdChoice::kAvx512:
      if (avx512) return Avx512RowKernels();
      break;
  }
  return absl::FailedPreconditionError(
      absl::StrCat("simd: this machine has no ", std::string(Name(choice)), "; auto takes what it has"));
}

}  // namespace voxelpipe::cpu
