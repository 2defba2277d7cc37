#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "fuzz/elements.h"
#include "fuzz/fuzz_checks.h"
#include "shaders/blend_ops.h"
#include "support/reference/fill_reference.h"
#include "support/reference/reference.h"

namespace voxelpipe::fuzz {
namespace {

uint32_t Stored(double number, VoxelFormat format) {
  return StoredBits(NumberToCell(number, format), format);
}

// Unsigned numbers in the order of the values: -0 before +0.
uint32_t OrderKey(uint32_t bits, VoxelFormat format) {
  if (format != VoxelFormat::kF16 && format != VoxelFormat::kF32) return bits;
  const uint32_t sign = format == VoxelFormat::kF16 ? 0x8000u : 0x80000000u;
  return (bits & sign) != 0 ? ~bits & (sign | (sign - 1)) : bits | sign;
}

// The blend of a voxel's values in order of triangle ids; false where it is not told from the stored values.
bool BlendOf(const std::vector<uint32_t>& values, const TargetSpec& spec, uint32_t& blended) {
  const bool integer = IsInteger(spec.format), bit = spec.format == VoxelFormat::kBit;
  const bool linear = spec.encoding == Encoding::kLinear;
  const auto less = [&](uint32_t a, uint32_t b) { return OrderKey(a, spec.format) < OrderKey(b, spec.format); };
  uint64_t sum = 0;
  uint32_t any = 0, all = ~0u;
  for (const uint32_t v : values) {
    sum += v;
    any |= v;
    all &= v;
  }
  const uint64_t most = LargestInteger(spec.format);
  switch (spec.blend) {
    case Blend::kReplace: blended = values.back(); return true;
    case Blend::kFirst: blended = values.front(); return true;
    case Blend::kMin: blended = *std::min_element(values.begin(), values.end(), less); return true;
    case Blend::kMax: blended = *std::max_element(values.begin(), values.end(), less); return true;
    case Blend::kOr: blended = any; return true;
    case Blend::kAnd: blended = all; return true;
    case Blend::kAdd: blended = uint32_t(std::min(sum, most)); return integer && linear;
    case Blend::kAverage:
      blended = uint32_t(std::nearbyint(double(sum) / double(values.size())));
      return integer && linear;
    case Blend::kCount: blended = bit ? 1 : uint32_t(std::min<uint64_t>(values.size(), most)); return bit || integer;
  }
  return false;
}

std::string Differ(const char* what, size_t target, int component, uint64_t voxel, uint32_t got, uint32_t expected) {
  return absl::StrCat(what, ": target ", target, " component ", component, " of voxel ", voxel, " is ", got,
                      ", expected ", expected, "\n");
}

}  // namespace

std::string CheckSparse(const VoxelizeResult& sparse, const VoxelizeResult& dense, const VoxelFlags* occupied) {
  const auto& dims = sparse.grid.dims;
  const int64_t bx = (dims[0] + 7) / 8, by = (dims[1] + 7) / 8;
  const uint64_t voxels = sparse.grid.voxels(), listed = sparse.listed_voxels();
  VoxelFlags seen(voxels, 0);
  uint64_t at = 0;
  for (uint64_t b = 0; b < sparse.listed_bricks(); ++b) {
    const uint64_t id = U64At(sparse.bricks, b);
    if (b > 0 && U64At(sparse.bricks, b - 1) >= id) return absl::StrCat("sparse: brick ", b, " is out of order\n");
    const auto x0 = int64_t(id % uint64_t(bx)) * 8, y0 = int64_t(id / uint64_t(bx) % uint64_t(by)) * 8;
    const auto z0 = int64_t(id / uint64_t(bx * by)) * 8;
    uint64_t here = 0;
    for (int i = 0; i < 512; ++i) {
      if ((sparse.masks.data()[b * 64 + uint64_t(i / 8)] >> (i % 8) & 1) == 0) continue;
      const int64_t x = x0 + i % 8, y = y0 + i / 8 % 8, z = z0 + i / 64;
      if (x >= dims[0] || y >= dims[1] || z >= dims[2]) return absl::StrCat("sparse: brick ", id, " leaves the grid\n");
      const auto n = uint64_t(x + dims[0] * (y + dims[1] * z));
      seen[n] = 1;
      for (size_t t = 0; t < sparse.specs.size(); ++t) {
        for (int c = 0; c < sparse.specs[t].components; ++c) {
          const uint32_t got = ElementAt(sparse, t, c, at, listed), expected = ElementAt(dense, t, c, n, voxels);
          if (got != expected) return Differ("sparse", t, c, n, got, expected);
        }
      }
      ++at;
      ++here;
    }
    if (here == 0) return absl::StrCat("sparse: brick ", id, " is empty\n");
  }
  for (uint64_t n = 0; n < voxels; ++n) {
    if (occupied != nullptr && (*occupied)[n] != seen[n]) {
      return absl::StrCat("sparse: voxel ", n, " is listed ", int(seen[n]), " times\n");
    }
    if (seen[n] != 0) continue;
    for (size_t t = 0; t < dense.specs.size(); ++t) {
      const uint32_t clear = Stored(dense.specs[t].clear, dense.specs[t].format);
      for (int c = 0; c < dense.specs[t].components; ++c) {
        const uint32_t got = ElementAt(dense, t, c, n, voxels);
        if (got != clear) return Differ("dense outside sparse", t, c, n, got, clear);
      }
    }
  }
  return "";
}

std::string CheckBuckets(const VoxelizeResult& buckets, const VoxelizeResult& counts,
                         const std::vector<IndexTriangle>& triangles, Coverage coverage) {
  const uint64_t voxels = buckets.listed_voxels(), all = buckets.grid.voxels();
  const auto& dims = buckets.grid.dims;
  uint64_t next = 0;  // the first voxel not yet compared
  for (uint64_t i = 0; i < voxels; ++i) {
    const uint64_t n = U64At(buckets.voxels, i);
    if (n >= all || n < next) return absl::StrCat("buckets: voxel ", i, " is out of order\n");
    for (; next < n; ++next) {
      if (ElementAt(counts, 0, 0, next, all) != 0) return absl::StrCat("buckets: voxel ", next, " is not listed\n");
    }
    ++next;
    const uint64_t begin = U64At(buckets.offsets, i), end = U64At(buckets.offsets, i + 1);
    if (end <= begin || end - begin != ElementAt(counts, 0, 0, n, all)) {
      return absl::StrCat("buckets: voxel ", n, " lists [", begin, ",", end, "), its count is ",
                          ElementAt(counts, 0, 0, n, all), "\n");
    }
    const auto x = int64_t(n % uint64_t(dims[0])), y = int64_t(n / uint64_t(dims[0]) % uint64_t(dims[1]));
    const auto z = int64_t(n / uint64_t(dims[0] * dims[1]));
    for (uint64_t f = begin; f < end; ++f) {
      const uint32_t t = U32At(buckets.triangles, f);
      if (t >= triangles.size() || (f > begin && U32At(buckets.triangles, f - 1) >= t)) {
        return absl::StrCat("buckets: triangle ", t, " is out of order in voxel ", n, "\n");
      }
      // Extras of triangles from afar are not bounded so closely; no bucket lists what is a voxel away.
      const auto& v = triangles[t].v;
      double farthest = 0;
      for (const Vec3d& p : v) farthest = std::max({farthest, std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
      if (farthest > 0x1p16) continue;
      if (!testing::Touches(v[0], v[1], v[2], x, y, z, coverage, 1e-3) &&
          !testing::Touches(v[0], v[1], v[2], x, y, z, Coverage::kConservative, 1e-3)) {
        return absl::StrCat("buckets: triangle ", t, " does not touch voxel ", n, "\n");
      }
    }
  }
  for (; next < all; ++next) {
    if (ElementAt(counts, 0, 0, next, all) != 0) return absl::StrCat("buckets: voxel ", next, " is not listed\n");
  }
  return "";
}

std::string CheckValues(const VoxelizeRequest& request, const VoxelizeResult& dense, const VoxelizeResult* buckets,
                        const VoxelFlags& filled) {
  const uint64_t voxels = dense.grid.voxels(), listed = buckets == nullptr ? 0 : buckets->listed_voxels();
  const int64_t nx = dense.grid.dims[0], ny = dense.grid.dims[1];
  for (size_t t = 0; t < dense.specs.size(); ++t) {
    const TargetSpec& spec = dense.specs[t];
    const uint32_t clear = Stored(spec.clear, spec.format);
    uint64_t bucket = 0;
    for (uint64_t n = 0; n < voxels; ++n) {
      const bool covered = bucket < listed && U64At(buckets->voxels, bucket) == n;
      const auto at = int64_t(n);
      for (int c = 0; c < spec.components; ++c) {
        uint32_t expected = clear;
        if (filled[n] != 0) {
          expected = testing::ReferenceFill(request, t, dense.grid, at % nx, at / nx % ny, at / nx / ny, c);
        }
        if (covered) {
          std::vector<uint32_t> values;
          for (uint64_t f = U64At(buckets->offsets, bucket); f < U64At(buckets->offsets, bucket + 1); ++f) {
            values.push_back(ElementAt(*buckets, t, c, f, buckets->listed_fragments()));
          }
          if (!BlendOf(values, spec, expected)) continue;
        }
        const uint32_t got = ElementAt(dense, t, c, n, voxels);
        if (got != expected) return Differ("values", t, c, n, got, expected);
      }
      bucket += covered;
    }
  }
  return "";
}

}  // namespace voxelpipe::fuzz
