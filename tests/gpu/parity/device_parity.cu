// Runs the arithmetic of core/raster and core/shaders on the device and on the host and compares the bits: row spans,
// tiles, barycentrics, crossings, every shader, conversion and blending, over a random soup with slivers, points, huge
// and outside triangles. And, on the device, quick normals (cuda/primitives/fast_normal.cuh) against plain ones, of
// many more vectors. Exit 0 if all agree, 1 if not, 77 (skipped) without a GPU.
#include <algorithm>
#include <cstdio>
#include <vector>

#include "cuda/primitives/fast_normal.cuh"
#include "grid/index_space.h"
#include "load/decode/mips.h"
#include "raster/crossing.h"
#include "raster/spans.h"
#include "raster/tiles.h"
#include "shaders/blend_ops.h"
#include "shaders/interface/fragment_input.h"
#include "shaders/shader_list.h"
#include "support/meshes/meshes.h"

namespace voxelpipe {
namespace {

constexpr int kTriangles = 40000;
constexpr int64_t kDims[3] = {67, 45, 33};
#define VOXELPIPE_ONE(name) +1
constexpr int kShaders = VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_ONE);
#undef VOXELPIPE_ONE

// FNV-1a over 8-byte words.
struct Digest {
  uint64_t value = 0xcbf29ce484222325ull;
  VOXELPIPE_HD void Add(uint64_t word) { value = (value ^ word) * 0x100000001b3ull; }
  VOXELPIPE_HD void Add(float f) {
    uint32_t bits;
    memcpy(&bits, &f, sizeof f);
    Add(uint64_t{bits});
  }
};

VOXELPIPE_HD void DigestFragment(const TrianglePlane& plane, FragmentInput& in, const ShaderParams& params,
                                 Digest& digest) {
  in.barycentric = Barycentrics(plane, in.voxel[0], in.voxel[1], in.voxel[2]);
  digest.Add(in.barycentric.x);
  digest.Add(in.barycentric.y);
  digest.Add(in.barycentric.z);
#pragma unroll 1
  for (int shader = 0; shader < kShaders; ++shader) {
    FragmentOutput out;
    ShadeFragment(FragmentShaderId(shader), in, params, out);
#pragma unroll 1
    for (int i = 0; i < 4; ++i) {
      digest.Add(ToF32(out, false, i));
      digest.Add(ToF32(out, true, i));
      digest.Add(uint64_t(Quantize(out.f[i], 0x1p-20)));
      digest.Add(BlendMin(out.f[i], in.barycentric.x));
      digest.Add(Dequantize(Quantize(out.f[i], 0x1p-20) * 3, 0x1p-20));
    }
    digest.Add(uint64_t{out.discard} + 2 * uint64_t{ToBit(out, false)});
  }
}

VOXELPIPE_HD Vec3d Corner(const Vec3d& position) {
  Vec3d corner = WorldToIndex({0.125, 0, 0}, {1, 1.0 / 3, 1}, position);
  corner.y /= 3;
  return corner;
}

// Everything that one triangle does, in one number.
VOXELPIPE_HD uint64_t DigestTriangle(const MeshView& mesh, uint32_t t, const ShaderParams& params) {
  Digest digest;
  const int64_t dims[3] = {kDims[0], kDims[1], kDims[2]};
  const VoxelRange all{{0, 0, 0}, {dims[0], dims[1], dims[2]}};
  const TileGrid tiles = TilesOf(dims);
  Vec3d corner[3];
  for (int i = 0; i < 3; ++i) {
    VertexInput in;
    in.flat.position = mesh.positions[mesh.triangles[t][i]];
    in.flat.normal = {0.25f, 0.5f, -1};
    const ShadedVertex shaded = ShadeVertex(VertexShaderId::kTransform, in, params);
    digest.Add(shaded.normal.y);
    digest.Add(float(shaded.velocity.x));
    corner[i] = Corner(in.flat.position);
  }
  ForEachTile(tiles, corner[0], corner[1], corner[2], [&](uint64_t tile) { digest.Add(tile); });
#pragma unroll 1  // one copy of the set-up keeps nvcc at seconds
  for (int c = 0; c < 3; ++c) {
    const Coverage coverage = Coverage(c);
    const TriangleSetup setup = SetUpTriangle(corner[0], corner[1], corner[2], coverage);
    const TrianglePlane plane = SetUpPlane(corner[0], corner[1], corner[2]);
    FragmentInput in = MakeFragmentInput(mesh, t, plane.degenerate, /*textured=*/true);
    digest.Add(in.uv_density[0]);
    int shaded = 0;
    ForEachRowSpan(setup, all, [&](int64_t y, int64_t z, int64_t begin, int64_t end) {
      digest.Add(uint64_t(y));
      digest.Add(uint64_t(z));
      digest.Add(uint64_t(begin));
      digest.Add(uint64_t(end));
      if (shaded++ > 16) return;  // enough fragments of the huge ones
      in.voxel[0] = begin;
      in.voxel[1] = y;
      in.voxel[2] = z;
      DigestFragment(plane, in, params, digest);
    });
    const VoxelRange range = ClipToRange(setup, all);
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      const double py = double(y) + 0.5, pz = double(range.begin[2]) + 0.5;
      if (!LineCrosses(corner[0], corner[1], corner[2], py, pz)) continue;
      digest.Add(uint64_t(CentresBefore(CrossingX(plane, corner[0], corner[1], corner[2], py, pz), dims[0])));
    }
  }
  return digest.value;
}

__global__ void DigestKernel(MeshView mesh, ShaderParams params, uint64_t* digests) {
  const uint32_t t = blockIdx.x * blockDim.x + threadIdx.x;
  if (t < mesh.triangle_count) digests[t] = DigestTriangle(mesh, t, params);
}

constexpr uint32_t kNormalThreads = 1 << 17, kNormalsOfThread = 512;

// A step of splitmix64 (G. L. Steele et al., "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014).
__device__ uint64_t Random(uint64_t& state) {
  uint64_t z = state += 0x9e3779b97f4a7c15;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9;
  z = (z ^ z >> 27) * 0x94d049bb133111eb;
  return z ^ z >> 31;
}

// Vectors of all directions and lengths, some along an axis or a plane, some of few bits, counts those whose quick
// normal differs.
__global__ void CompareNormals(unsigned long long* different) {
  uint64_t state = blockIdx.x * blockDim.x + threadIdx.x;
  for (uint32_t i = 0; i < kNormalsOfThread; ++i) {
    double v[3];
    const uint64_t kind = Random(state) % 16;
    const double scale = ldexp(1.0, int(Random(state) % (kind == 0 ? 2000 : 40)) - (kind == 0 ? 1000 : 20));
    for (double& of : v) {
      const uint64_t bits = Random(state);
      const double part = kind == 1 ? double(bits % 7) - 3 : double(int64_t(bits)) * 0x1p-63;
      const int smaller = kind == 2 ? int(bits % 200) : kind == 3 ? int(bits % 30) : 0;
      of = kind == 4 && bits % 3 == 0 ? 0.0 : ldexp(part, -smaller) * scale;
    }
    const Vec3d vector{v[0], v[1], v[2]};
    const Vec3f quick = cuda::QuickNormalized(vector), plain = Normalized(vector);
    const bool same =
        BitsOf(quick.x) == BitsOf(plain.x) && BitsOf(quick.y) == BitsOf(plain.y) && BitsOf(quick.z) == BitsOf(plain.z);
    if (!same) atomicAdd(different, 1ull);
  }
}

bool Check(cudaError_t error, const char* what) {
  if (error != cudaSuccess) std::fprintf(stderr, "%s: %s\n", what, cudaGetErrorString(error));
  return error == cudaSuccess;
}

template <typename T>
const T* Upload(const std::vector<T>& values) {
  T* device = nullptr;
  if (!Check(cudaMalloc(&device, values.size() * sizeof(T)), "cudaMalloc")) return nullptr;
  if (!Check(cudaMemcpy(device, values.data(), values.size() * sizeof(T), cudaMemcpyHostToDevice), "cudaMemcpy"))
    return nullptr;
  return device;
}

// The soup with vertex normals, tangents, texture coordinates, colours, velocities and a textured material.
struct Assets {
  TriangleMesh mesh = testing::Soup(kTriangles, 60, 4242);
  std::vector<Vec3d> index_positions;
  std::vector<Vec3f> normals, velocities;
  std::vector<Vec2f> uv;
  std::vector<Vec4f> colors, tangents;
  std::vector<PartView> parts;
  std::vector<MaterialView> materials;
  std::vector<uint8_t> texels;
  std::vector<Vec4f> mips;
  std::vector<TextureView> textures;
  std::vector<float> heat;
  std::vector<AttributeView> attributes;

  Assets() {
    for (size_t i = 0; i < mesh.positions.size(); ++i) {
      const float f = float(i % 101) / 50 - 1;
      index_positions.push_back(Corner(mesh.positions[i]));
      normals.push_back({f, 1 - f, 0.3f * f});
      velocities.push_back({3 * f, f * f, -f});
      tangents.push_back({1 - f, f, 0.1f, f < 0 ? -1.0f : 1.0f});
      heat.insert(heat.end(), {f, 2 * f, -f});
      uv.push_back({3 * f, -f});
      colors.push_back({0.5f, f * f, 1, 0.7f});
    }
    PartView bare;
    PartView full;
    full.first_triangle = kTriangles / 4;
    full.has_normals = full.has_tangents = full.has_colors = full.has_uv[0] = full.has_uv[1] = true;
    parts = {bare, full};
    MaterialView material;
    material.base_color.texture = 0;
    material.base_color.texels = 60;
    material.emissive = material.base_color;
    material.emissive.texels = 900;  // far into the smaller levels
    material.emissive_factor = {2, 0.5f, 0.125f};
    material.metallic_roughness = material.base_color;
    material.metallic_roughness.texture = 1;
    material.alpha_mask = true;
    material.alpha_cutoff = 0.5f;
    materials = {material};
    for (int i = 0; i < 7 * 5 * 4; ++i) texels.push_back(uint8_t(i * 37));
    mips = *BuildMips({}, texels.data(), 7, 5, true);
  }

  static TextureView Texture(const uint8_t* rgba, const Vec4f* mips, bool srgb) {
    TextureView texture;
    texture.mips = mips;
    texture.levels = CountLevels(7, 5);
    texture.mip_filter = srgb ? 2 : 1;
    texture.srgb = srgb;
    texture.rgba = rgba;
    texture.width = 7;
    texture.height = 5;
    texture.wrap_t = 1;
    return texture;
  }

  MeshView View(bool on_device) {
    const auto at = [&](const auto& values) { return on_device ? Upload(values) : values.data(); };
    textures = {Texture(at(texels), at(mips), true), Texture(at(texels), at(mips), false)};
    MeshView view;
    view.positions = at(mesh.positions);
    view.index_positions = at(index_positions);
    std::copy_n(kDims, 3, view.grid_dims);
    view.normals = at(normals);
    view.tangents = at(tangents);
    view.velocities = at(velocities);
    view.uv[0] = view.uv[1] = at(uv);
    view.colors = at(colors);
    view.triangles = reinterpret_cast<const uint32_t(*)[3]>(at(mesh.triangles));
    view.parts = at(parts);
    view.materials = at(materials);
    view.textures = at(textures);
    attributes = {{at(heat), 3}};
    view.attributes = at(attributes);
    view.attribute_count = 1;
    view.vertex_count = mesh.positions.size();
    view.triangle_count = mesh.triangles.size();
    view.part_count = uint32_t(parts.size());
    view.material_count = 1;
    view.texture_count = uint32_t(textures.size());
    return view;
  }
};

int Main() {
  int devices = 0;
  if (cudaGetDeviceCount(&devices) != cudaSuccess || devices == 0) {
    std::printf("SKIPPED: this machine has no CUDA device\n");
    return 77;
  }
  ShaderParams params;
  for (int i = 0; i < 16; ++i) params.value[i] = i % 5 == 0 ? 1.0 : 0.1 * (i - 7);
  Assets assets;
  uint64_t* digests = nullptr;
  if (!Check(cudaMalloc(&digests, kTriangles * sizeof(uint64_t)), "cudaMalloc")) return 1;
  DigestKernel<<<(kTriangles + 127) / 128, 128>>>(assets.View(true), params, digests);
  std::vector<uint64_t> device(kTriangles);
  if (!Check(cudaGetLastError(), "launch") ||
      !Check(cudaMemcpy(device.data(), digests, kTriangles * sizeof(uint64_t), cudaMemcpyDeviceToHost), "cudaMemcpy")) {
    return 1;
  }
  const MeshView host = assets.View(false);
  int different = 0;
  for (uint32_t t = 0; t < kTriangles; ++t) {
    if (DigestTriangle(host, t, params) != device[t] && ++different <= 5)
      std::printf("triangle %u (kind %u) differs\n", t, t % 8);
  }
  cudaDeviceProp properties;
  cudaGetDeviceProperties(&properties, 0);
  std::printf("%s: %d of %d triangles give the same bits on device and host\n", properties.name, kTriangles - different,
              kTriangles);
  unsigned long long* counter = nullptr;
  unsigned long long normals = 0;
  if (!Check(cudaMalloc(&counter, sizeof normals), "cudaMalloc") ||
      !Check(cudaMemset(counter, 0, sizeof normals), "cudaMemset")) {
    return 1;
  }
  CompareNormals<<<kNormalThreads / 128, 128>>>(counter);
  if (!Check(cudaMemcpy(&normals, counter, sizeof normals, cudaMemcpyDeviceToHost), "cudaMemcpy")) return 1;
  std::printf("%llu of %llu quick normals differ from plain ones\n", normals, 0ull + kNormalThreads * kNormalsOfThread);
  return different == 0 && normals == 0 ? 0 : 1;
}

}  // namespace
}  // namespace voxelpipe

int main() {
  return voxelpipe::Main();
}
