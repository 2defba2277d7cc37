#include "support/reference/value_reference.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>

#include "mesh/views/material_views.h"
#include "raster/spans.h"
#include "shaders/catalog.h"
#include "shaders/interface/fragment_input.h"
#include "shaders/shader_list.h"
#include "support/reference/fill_reference.h"

namespace voxelpipe::testing {
namespace {

using Wide = __int128;

bool IsFloat(VoxelFormat format) {
  return format == VoxelFormat::kF16 || format == VoxelFormat::kF32;
}

bool OutputsU32(const TargetSpec& spec) {
  return std::set<std::string>{"triangle_id", "material_id", "mesh_id", "packed_normal"}.count(spec.shader.name) != 0;
}

double Scale(const TargetSpec& spec) {
  if (spec.scale) return *spec.scale;
  const std::set<std::string> scaled = {"base_color", "color", "emissive", "metallic_roughness"};
  if (scaled.count(spec.shader.name) == 0) return 1;
  return spec.format == VoxelFormat::kU8 ? 255 : spec.format == VoxelFormat::kU16 ? 65535 : 1;
}

uint32_t Most(VoxelFormat format) {
  return format == VoxelFormat::kU8 ? 255 : format == VoxelFormat::kU16 ? 65535 : UINT32_MAX;
}

// std::nearbyint rounds to nearest even, the mode in which programs start.
uint32_t NearestInteger(double v, uint32_t most) {
  if (std::isnan(v)) return 0;
  const double rounded = std::nearbyint(v);
  if (rounded <= 0) return 0;
  return rounded >= double(most) ? most : uint32_t(rounded);
}

// Magnitudes of the binary16 numbers by their bits; the one after the last finite stands for infinity.
const std::vector<double>& HalfMagnitudes() {
  static const std::vector<double> all = [] {
    std::vector<double> values;
    for (int bits = 0; bits < 0x7c00; ++bits) {
      const int exponent = bits >> 10, mantissa = bits & 1023;
      values.push_back(exponent == 0 ? std::ldexp(mantissa, -24) : std::ldexp(1024 + mantissa, exponent - 25));
    }
    values.push_back(65536);
    return values;
  }();
  return all;
}

uint16_t NearestHalf(long double v) {
  if (std::isnan(v)) return 0;
  const auto sign = uint16_t(std::signbit(v) ? 0x8000 : 0);
  const long double a = std::fabs(v);
  const std::vector<double>& values = HalfMagnitudes();
  if (a >= values.back()) return sign | 0x7c00;
  const auto above = size_t(std::upper_bound(values.begin(), values.end(), a) - values.begin()), below = above - 1;
  const long double down = a - values[below], up = values[above] - a;
  const size_t nearest = down < up ? below : up < down ? above : below + below % 2;
  return uint16_t(sign | nearest);
}

double HalfValue(uint16_t bits) {
  const size_t magnitude = bits & 0x7fff;
  const double v = magnitude == 0x7c00 ? std::numeric_limits<double>::infinity() : HalfMagnitudes()[magnitude];
  return (bits & 0x8000) != 0 ? -v : v;
}

uint32_t FloatStored(long double v, VoxelFormat format) {
  if (format == VoxelFormat::kF16) return NearestHalf(v);
  const float f = std::isnan(v) ? 0 : float(v);
  uint32_t bits;
  std::memcpy(&bits, &f, sizeof bits);
  return bits;
}

// What the shader gave, exactly; NaN is 0.
double Given(const TargetSpec& spec, const FragmentOutput& out, int c) {
  const double v = OutputsU32(spec) ? double(out.u[c]) : double(out.f[c]);
  return std::isnan(v) ? 0 : v;
}

// The nearest 8-bit sRGB code, by the transfer function itself; alpha is linear.
uint32_t SrgbCode(long double v, int c) {
  if (c == 3) return NearestInteger(double(v * 255), 255);
  if (!(v > 0)) return 0;
  const long double encoded = v <= 0.0031308L ? 12.92L * v : 1.055L * std::pow(v, 1 / 2.4L) - 0.055L;
  return uint32_t(std::min(255.0L, std::floor(encoded * 255 + 0.5L)));
}

// The value as its target's encoding has it.
uint32_t Code(const TargetSpec& spec, long double v, int c) {
  if (spec.encoding == Encoding::kSrgb) return SrgbCode(v, c);
  const uint32_t most = Most(spec.format);
  return NearestInteger(double((v / 2 + 0.5L) * most), most);
}

uint32_t ConvertedInteger(const TargetSpec& spec, const FragmentOutput& out, int c) {
  const uint32_t most = Most(spec.format);
  if (spec.encoding != Encoding::kLinear) return Code(spec, Given(spec, out, c), c);
  if (OutputsU32(spec)) return std::min(out.u[c], most);
  return NearestInteger(Given(spec, out, c) * Scale(spec), most);
}

double ConvertedFloat(const TargetSpec& spec, const FragmentOutput& out, int c) {
  if (spec.format == VoxelFormat::kF16) return HalfValue(NearestHalf(Given(spec, out, c)));
  return double(float(Given(spec, out, c)));
}

uint32_t BlendBits(Blend blend, const std::vector<bool>& v) {
  switch (blend) {
    case Blend::kReplace: return v.back();
    case Blend::kFirst: return v.front();
    case Blend::kAnd: return std::count(v.begin(), v.end(), false) == 0;
    case Blend::kOr: return std::count(v.begin(), v.end(), true) != 0;
    default: return 1;  // count
  }
}

uint32_t BlendIntegers(Blend blend, const std::vector<uint32_t>& v, uint32_t most) {
  Wide sum = 0;
  uint32_t any = 0, all = UINT32_MAX;
  for (const uint32_t x : v) {
    sum += x;
    any |= x;
    all &= x;
  }
  switch (blend) {
    case Blend::kReplace: return v.back();
    case Blend::kFirst: return v.front();
    case Blend::kMin: return *std::min_element(v.begin(), v.end());
    case Blend::kMax: return *std::max_element(v.begin(), v.end());
    case Blend::kAdd: return sum > Wide{most} ? most : uint32_t(sum);
    case Blend::kAverage: return NearestInteger(double(sum) / double(v.size()), most);
    case Blend::kOr: return any;
    case Blend::kAnd: return all;
    default: return v.size() > most ? most : uint32_t(v.size());  // count
  }
}

// Sorted so that -0 comes before +0.
uint32_t BlendOrdered(const TargetSpec& spec, std::vector<double> v) {
  const double first = v.front(), last = v.back();
  std::sort(v.begin(), v.end(),
            [](double a, double b) { return a < b || (a == b && std::signbit(a) > std::signbit(b)); });
  switch (spec.blend) {
    case Blend::kReplace: return FloatStored(last, spec.format);
    case Blend::kFirst: return FloatStored(first, spec.format);
    case Blend::kMin: return FloatStored(v.front(), spec.format);
    default: return FloatStored(v.back(), spec.format);  // max
  }
}

uint32_t BlendSums(const TargetSpec& spec, const std::vector<FragmentOutput>& fragments, int c) {
  Wide sum = 0;
  for (const FragmentOutput& out : fragments) {
    const double multiple = double(float(Given(spec, out, c))) / spec.quantum;
    sum += Wide(std::nearbyint(std::clamp(multiple, -0x1p40, 0x1p40)));
  }
  const long double total = static_cast<long double>(sum) * spec.quantum;
  const double average = double(sum) * spec.quantum / double(fragments.size());
  if (spec.encoding != Encoding::kLinear) return Code(spec, spec.blend == Blend::kAdd ? total : average, c);
  return FloatStored(spec.blend == Blend::kAdd ? total : static_cast<long double>(average), spec.format);
}

// Elements of an array, written in any order.
class Elements {
 public:
  Elements(VoxelFormat format, uint64_t count)
      : bits_(format == VoxelFormat::kBit   ? 1
              : format == VoxelFormat::kU8  ? 8
              : format == VoxelFormat::kU16 ? 16
              : format == VoxelFormat::kF16 ? 16
                                            : 32),
        bytes_((count * bits_ + 7) / 8) {}
  void Put(uint64_t at, uint32_t stored) {
    for (uint64_t b = 0; b < bits_; ++b) {
      const uint64_t n = at * bits_ + b;
      if ((stored >> b & 1) != 0) bytes_[n / 8] = uint8_t(bytes_[n / 8] | 1u << (n % 8));
    }
  }
  std::vector<uint8_t> Take() { return std::move(bytes_); }

 private:
  uint64_t bits_;
  std::vector<uint8_t> bytes_;
};

template <typename T>
std::vector<uint8_t> ArrayBytes(const std::vector<T>& values) {
  std::vector<uint8_t> bytes(values.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

// Shades single fragments of a mesh that lies in index space.
class Shading {
 public:
  Shading(const TriangleMesh& mesh, const VoxelizeRequest& request) : mesh_(mesh), materials_(MakeMaterialViews(mesh)) {
    for (const MeshPart& part : mesh.parts) {
      PartView view;
      view.first_triangle = part.first_triangle;
      view.material = part.material >= 0 ? part.material : int32_t(mesh.materials.size());
      view.mesh = part.mesh;
      view.has_normals = part.has_normals;
      view.has_tangents = part.has_tangents;
      view.has_colors = part.has_colors;
      for (int i = 0; i < 2; ++i) view.has_uv[i] = part.has_uv[i];
      parts_.push_back(view);
    }
    view_.positions = view_.index_positions = mesh.positions.data();
    std::copy_n(request.grid.dims->data(), 3, view_.grid_dims);
    view_.normals = mesh.normals.data();
    view_.tangents = mesh.tangents.data();
    view_.colors = mesh.colors.data();
    for (int i = 0; i < 2; ++i) view_.uv[i] = mesh.uv[i].data();
    view_.triangles = reinterpret_cast<const uint32_t(*)[3]>(mesh.triangles.data());
    view_.parts = parts_.data();
    view_.materials = materials_.materials.data();
    view_.textures = materials_.textures.data();
    view_.part_count = uint32_t(parts_.size());
    view_.material_count = uint32_t(materials_.materials.size());
    view_.texture_count = uint32_t(materials_.textures.size());
    for (const TargetSpec& spec : request.targets) shaders_.push_back(*BindShader(ShaderStage::kFragment, spec.shader));
  }

  FragmentOutput Shade(size_t target, uint32_t triangle, int64_t x, int64_t y, int64_t z) const {
    const auto& v = mesh_.triangles[triangle];
    const TrianglePlane plane = SetUpPlane(mesh_.positions[v[0]], mesh_.positions[v[1]], mesh_.positions[v[2]]);
    FragmentInput in = MakeFragmentInput(view_, triangle, plane.degenerate, true);
    in.barycentric = Barycentrics(plane, x, y, z);
    in.voxel[0] = x;
    in.voxel[1] = y;
    in.voxel[2] = z;
    FragmentOutput out;
    ShadeFragment(FragmentShaderId(shaders_[target].id), in, shaders_[target].params, out);
    return out;
  }

 private:
  const TriangleMesh& mesh_;
  MaterialViews materials_;
  std::vector<PartView> parts_;
  MeshView view_;
  std::vector<BoundShader> shaders_;
};

// Everything that the shaders gave: outputs[target][fragment], fragments of all voxels one after the other.
struct Fragments {
  std::vector<uint64_t> voxel;
  std::vector<uint32_t> triangle;
  std::vector<std::vector<FragmentOutput>> outputs;
};

Fragments ShadeAll(const TriangleMesh& mesh, const VoxelizeRequest& request, const std::array<int64_t, 3>& dims) {
  const Shading shading(mesh, request);
  Fragments all;
  all.outputs.resize(request.targets.size());
  const auto lists = FragmentLists(mesh, dims, request.coverage);
  for (uint64_t n = 0; n < lists.size(); ++n) {
    const int64_t x = int64_t(n) % dims[0], y = int64_t(n) / dims[0] % dims[1], z = int64_t(n) / dims[0] / dims[1];
    for (const uint32_t triangle : lists[n]) {
      std::vector<FragmentOutput> outputs;
      bool kept = false;
      for (size_t t = 0; t < request.targets.size(); ++t) {
        outputs.push_back(shading.Shade(t, triangle, x, y, z));
        kept = kept || !outputs.back().discard;
      }
      if (!kept) continue;  // every target's shader discards it: it does not happen
      all.voxel.push_back(n);
      all.triangle.push_back(triangle);
      for (size_t t = 0; t < outputs.size(); ++t) all.outputs[t].push_back(outputs[t]);
    }
  }
  return all;
}

uint64_t ElementAt(const VoxelizeRequest& request, const TargetSpec& spec, uint64_t count, uint64_t n, int c) {
  const auto components = uint64_t(spec.components);
  return request.layout == Layout::kPlanar ? uint64_t(c) * count + n : n * components + uint64_t(c);
}

// The values of the listed voxels, or of all of them.
std::vector<uint8_t> VoxelValues(const VoxelizeRequest& request, const Fragments& all, size_t t,
                                 const std::vector<bool>& inside, const std::vector<uint64_t>& listed) {
  const TargetSpec& spec = request.targets[t];
  Elements elements(spec.format, listed.size() * uint64_t(spec.components));
  GridSpec grid;
  grid.dims = *request.grid.dims;
  for (uint64_t i = 0; i < listed.size(); ++i) {
    const auto [begin, end] = std::equal_range(all.voxel.begin(), all.voxel.end(), listed[i]);
    std::vector<FragmentOutput> fragments;
    for (auto at = begin; at != end; ++at) {
      const FragmentOutput& out = all.outputs[t][size_t(at - all.voxel.begin())];
      if (!out.discard) fragments.push_back(out);
    }
    const bool filled = !inside.empty() && inside[listed[i]];
    const auto n = int64_t(listed[i]), nx = grid.dims[0], ny = grid.dims[1];
    for (int c = 0; c < spec.components; ++c) {
      elements.Put(ElementAt(request, spec, listed.size(), i, c),
                   !fragments.empty() ? ReferenceBlend(spec, fragments, c)
                   : filled           ? ReferenceFill(request, t, grid, n % nx, n / nx % ny, n / nx / ny, c)
                                      : ReferenceNumber(spec.clear, spec.format));
    }
  }
  return elements.Take();
}

// Voxels with a fragment or filled, brick after brick.
struct Bricks {
  std::vector<uint64_t> ids, voxels;
  std::vector<uint8_t> masks;
};
Bricks ListBricks(const std::array<int64_t, 3>& dims, const std::vector<bool>& occupied) {
  Bricks bricks;
  uint64_t id = 0;
  for (int64_t bz = 0; bz < dims[2]; bz += 8) {
    for (int64_t by = 0; by < dims[1]; by += 8) {
      for (int64_t bx = 0; bx < dims[0]; bx += 8, ++id) {
        std::array<uint8_t, 64> mask{};
        bool any = false;
        for (int i = 0; i < 512; ++i) {
          const int64_t x = bx + i % 8, y = by + i / 8 % 8, z = bz + i / 64;
          if (x >= dims[0] || y >= dims[1] || z >= dims[2]) continue;
          const auto n = uint64_t(x + dims[0] * (y + dims[1] * z));
          if (!occupied[n]) continue;
          any = true;
          mask[size_t(i / 8)] = uint8_t(mask[size_t(i / 8)] | 1u << (i % 8));
          bricks.voxels.push_back(n);
        }
        if (!any) continue;
        bricks.ids.push_back(id);
        bricks.masks.insert(bricks.masks.end(), mask.begin(), mask.end());
      }
    }
  }
  return bricks;
}

std::vector<std::vector<uint8_t>> BucketArrays(const VoxelizeRequest& request, const Fragments& all) {
  std::vector<uint64_t> voxels, offsets;
  for (uint64_t i = 0; i < all.voxel.size(); ++i) {
    if (i != 0 && all.voxel[i] == all.voxel[i - 1]) continue;
    voxels.push_back(all.voxel[i]);
    offsets.push_back(i);
  }
  offsets.push_back(all.voxel.size());
  std::vector<std::vector<uint8_t>> arrays{ArrayBytes(voxels), ArrayBytes(offsets), ArrayBytes(all.triangle)};
  for (size_t t = 0; t < request.targets.size(); ++t) {
    TargetSpec spec = request.targets[t];
    spec.blend = Blend::kFirst;  // of one fragment: its converted value
    Elements elements(spec.format, all.voxel.size() * uint64_t(spec.components));
    for (uint64_t i = 0; i < all.voxel.size(); ++i) {
      const FragmentOutput& out = all.outputs[t][i];
      for (int c = 0; c < spec.components; ++c) {
        elements.Put(ElementAt(request, spec, all.voxel.size(), i, c),
                     out.discard ? ReferenceNumber(spec.clear, spec.format) : ReferenceBlend(spec, {out}, c));
      }
    }
    arrays.push_back(elements.Take());
  }
  return arrays;
}

}  // namespace

std::vector<std::vector<uint32_t>> FragmentLists(const TriangleMesh& mesh, const std::array<int64_t, 3>& dims,
                                                 Coverage coverage) {
  std::vector<std::vector<uint32_t>> lists(size_t(dims[0] * dims[1] * dims[2]));
  const VoxelRange all{{0, 0, 0}, {dims[0], dims[1], dims[2]}};
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& v = mesh.triangles[t];
    ForEachRowSpan(SetUpTriangle(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], coverage), all,
                   [&](int64_t y, int64_t z, int64_t x0, int64_t x1) {
                     for (int64_t x = x0; x < x1; ++x) lists[size_t(x + dims[0] * (y + dims[1] * z))].push_back(t);
                   });
  }
  return lists;
}

uint32_t ReferenceNumber(double v, VoxelFormat format) {
  if (format == VoxelFormat::kBit) return v != 0;
  return IsFloat(format) ? FloatStored(v, format) : NearestInteger(v, Most(format));
}

uint32_t ReferenceBlend(const TargetSpec& spec, const std::vector<FragmentOutput>& fragments, int c) {
  if (spec.format == VoxelFormat::kBit) {
    std::vector<bool> bits;
    for (const FragmentOutput& out : fragments) bits.push_back(Given(spec, out, 0) != 0);
    return BlendBits(spec.blend, bits);
  }
  const bool sums = spec.blend == Blend::kAdd || spec.blend == Blend::kAverage;
  if (!IsFloat(spec.format) && !(sums && spec.encoding != Encoding::kLinear)) {
    std::vector<uint32_t> integers;
    for (const FragmentOutput& out : fragments) integers.push_back(ConvertedInteger(spec, out, c));
    return BlendIntegers(spec.blend, integers, Most(spec.format));
  }
  if (spec.blend == Blend::kCount) return FloatStored(fragments.size(), spec.format);
  if (sums) return BlendSums(spec, fragments, c);
  std::vector<double> floats;
  for (const FragmentOutput& out : fragments) floats.push_back(ConvertedFloat(spec, out, c));
  return BlendOrdered(spec, floats);
}

std::vector<std::vector<uint8_t>> ReferenceArrays(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                                  const std::vector<bool>& inside) {
  const std::array<int64_t, 3> dims = *request.grid.dims;
  const Fragments all = ShadeAll(mesh, request, dims);
  if (request.result == ResultKind::kBuckets) return BucketArrays(request, all);
  std::vector<std::vector<uint8_t>> arrays;
  std::vector<uint64_t> listed;
  const auto voxels = uint64_t(dims[0] * dims[1] * dims[2]);
  if (request.result == ResultKind::kSparse) {
    std::vector<bool> occupied = inside.empty() ? std::vector<bool>(voxels) : inside;
    for (const uint64_t n : all.voxel) occupied[n] = true;
    Bricks bricks = ListBricks(dims, occupied);
    arrays.push_back(ArrayBytes(bricks.ids));
    arrays.push_back(std::move(bricks.masks));
    listed = std::move(bricks.voxels);
  } else {
    for (uint64_t n = 0; n < voxels; ++n) listed.push_back(n);
  }
  for (size_t t = 0; t < request.targets.size(); ++t) {
    arrays.push_back(VoxelValues(request, all, t, inside, listed));
  }
  return arrays;
}

}  // namespace voxelpipe::testing
