// The vector kernels of shading against the scalar functions: every bit, on ordinary and on odd triangles, textures and
// values.
#include "cpu/shading/shade_kernels.h"

#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "cpu/rows/row_kernels.h"
#include "gtest/gtest.h"
#include "mesh/views/mips.h"

namespace voxelpipe::cpu {
namespace {

constexpr uint8_t kWrapModes = 3, kMipFilters = 3;

// A mesh of one part, with everything that a shader reads.
struct Scene {
  std::vector<Vec3d> positions, index_positions;
  std::vector<Vec3f> normals, velocities;
  std::vector<Vec4f> tangents, colors;
  std::vector<Vec2f> uv[2];
  std::vector<float> heat;
  AttributeView attribute;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<uint8_t> texels;
  std::vector<Vec4f> mips;
  TextureView texture;
  MaterialView material;
  PartView part;
  MeshView view;

  Scene(std::mt19937& random, uint32_t width, uint32_t height) {
    std::uniform_real_distribution<double> unit(0, 1);
    const auto number = [&](double lo, double hi) { return float(lo + (hi - lo) * unit(random)); };
    constexpr int kTriangles = 300;
    for (int t = 0; t < kTriangles; ++t) {
      const double size = std::array{0.3, 2.0, 20.0, 500.0, 1e-7, 0.0}[size_t(t % 6)];
      const Vec3d at{40 * unit(random), 40 * unit(random), 40 * unit(random)};
      for (int corner = 0; corner < 3; ++corner) {
        Vec3d p = at + Vec3d{unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5} * size;
        if (t % 7 == 0 && corner == 2) p = positions.back() + (positions.back() - positions[positions.size() - 2]);
        if (t % 11 == 0) p.x = -0.0;
        positions.push_back(p);
        index_positions.push_back(p * (1 / 0.75));
        const double length = t % 13 == 0 ? 0 : 1;
        normals.push_back({number(-1, 1) * float(length), number(-1, 1) * float(length), float(length)});
        if (t % 29 == 0) normals.back().x = std::numeric_limits<float>::quiet_NaN();
        tangents.push_back({number(-1, 1), number(-1, 1), number(-1, 1), t % 2 == 0 ? 1.0f : -1.0f});
        colors.push_back({number(-1, 2), number(0, 1), number(0, 1), number(0, 1)});
        velocities.push_back({number(-9, 9), number(-9, 9), number(-9, 9)});
        for (auto& set : uv) set.push_back({number(-2, 3), number(-2, 3)});
        if (t % 31 == 0) uv[0].back().x = std::numeric_limits<float>::infinity();
        if (t % 5 == 0 && corner > 0) uv[0].back() = uv[0][uv[0].size() - 2];  // no area
        for (int c = 0; c < 3; ++c) heat.push_back(number(-300, 300));
      }
      const auto first = uint32_t(3 * t);
      triangles.push_back({first, first + 1, first + 2});
    }
    texture.width = width;
    texture.height = height;
    texture.levels = CountLevels(width, height);
    for (uint64_t i = 0; i < uint64_t{width} * height * 4; ++i) texels.push_back(uint8_t(random()));
    for (uint64_t i = 0; i < LevelOffset(width, height, texture.levels); ++i) {
      mips.push_back({number(0, 1), number(0, 1), number(0, 1), number(0, 1)});
    }
    texture.rgba = texels.data();
    texture.mips = mips.empty() ? nullptr : mips.data();
    material.base_color_factor = {0.5f, 0.75f, 1, 0.9f};
    material.emissive_factor = {2, 3, 0.5f};
    material.metallic_factor = 0.25f;
    for (TextureRefView* ref : {&material.base_color, &material.emissive, &material.metallic_roughness}) {
      ref->texture = 0;
      ref->m[0][0] = 0.9f;
      ref->m[0][1] = -0.1f;
      ref->m[1][2] = 0.3f;
      ref->texels = 0.9f * std::sqrt(float(width) * float(height));
    }
    material.emissive.uv_set = 1;
    material.alpha_cutoff = 0.5f;
    part.has_normals = part.has_tangents = part.has_colors = part.has_uv[0] = part.has_uv[1] = true;
    attribute = {heat.data(), 3, 0, nullptr};
    view.positions = positions.data();
    view.index_positions = index_positions.data();
    view.normals = normals.data();
    view.velocities = velocities.data();
    view.tangents = tangents.data();
    view.colors = colors.data();
    for (int set = 0; set < 2; ++set) view.uv[set] = uv[set].data();
    view.attributes = &attribute;
    view.triangles = reinterpret_cast<const uint32_t(*)[3]>(triangles.data());
    view.parts = &part;
    view.materials = &material;
    view.textures = &texture;
    view.vertex_count = positions.size();
    view.triangle_count = triangles.size();
    view.part_count = view.material_count = view.texture_count = view.attribute_count = 1;
  }
};

// Fragments of some triangles in the tile in which the middle of the mesh lies, which is in and around some of them.
FragmentBatch MakeBatch(const Scene& scene, std::mt19937& random, int fragments) {
  FragmentBatch batch;
  batch.mesh = &scene.view;
  batch.part = &scene.part;
  for (int a = 0; a < 3; ++a) batch.origin[a] = int32_t(random() % 40);
  while (batch.count < fragments) {
    batch.AddTriangle(uint32_t(random() % scene.triangles.size()));
    for (uint32_t more = random() % 5; batch.count < fragments; --more) {
      batch.AddFragment(random() % kTileVoxels);
      if (more == 0) break;
    }
  }
  batch.Complete();
  return batch;
}

bool SameBits(float a, float b) {
  return std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b) || (std::isnan(a) && std::isnan(b));
}

std::vector<std::string> VectorSets() {
  std::vector<std::string> names;
  if (SelectRowKernels(SimdChoice::kAvx2).ok()) names.push_back("avx2");
  if (SelectRowKernels(SimdChoice::kAvx512).ok()) names.push_back("avx512");
  return names;
}

void ExpectPlaced(const ShadeKernels& kernels, FragmentBatch& batch) {
  FragmentBatch expected = batch;
  ShadeKernelsNamed("scalar").place(expected);
  kernels.place(batch);
  for (int i = 0; i < batch.count; ++i) {
    ASSERT_EQ(batch.degenerate[batch.triangle_of[i]], expected.degenerate[batch.triangle_of[i]]) << i;
    for (int k = 0; k < 3; ++k) {
      ASSERT_PRED2(SameBits, batch.barycentric[k][i], expected.barycentric[k][i])
          << "fragment " << i << " of triangle " << batch.triangle[batch.triangle_of[i]];
    }
  }
}

// True if the kernels have the shader.
bool ExpectShaded(const ShadeKernels& kernels, FragmentShaderId shader, const FragmentBatch& batch) {
  ShaderParams params;
  params.value[0] = 1;
  ShadedBatch out, expected;
  if (!kernels.shade(shader, batch, params, out)) return false;
  ShadeOneByOne(shader, batch, params, expected);
  for (int i = 0; i < batch.count; ++i) {
    EXPECT_EQ(out.discard[i], expected.discard[i]) << "shader " << int(shader);
    for (int c = 0; c < 4; ++c) {
      if (shader == FragmentShaderId::kPackedNormal) {
        EXPECT_EQ(out.u[c][i], expected.u[c][i]);
      } else {
        EXPECT_PRED2(SameBits, out.f[c][i], expected.f[c][i])
            << "shader " << int(shader) << ", component " << c << ", triangle " << batch.triangle[batch.triangle_of[i]];
      }
    }
    if (::testing::Test::HasFailure()) return true;
  }
  return true;
}

TEST(ShadeKernels, VectorsGiveTheBitsOfTheScalarFunctions) {
  std::mt19937 random(5);
  int shaded = 0;
  for (const auto& [width, height] : {std::pair{1u, 1u}, {4u, 4u}, {7u, 5u}, {64u, 16u}}) {
    Scene scene(random, width, height);
    for (int variant = 0; variant < 36; ++variant) {
      scene.texture.wrap_s = uint8_t(variant % kWrapModes);
      scene.texture.wrap_t = uint8_t(variant / 2 % kWrapModes);
      scene.texture.mip_filter = uint8_t(variant / 3 % kMipFilters);
      scene.texture.srgb = variant % 2 == 0;
      scene.texture.min_nearest = variant % 9 == 8;
      scene.material.alpha_mask = variant % 4 == 1;
      scene.part.has_colors = variant % 5 != 2;
      for (const int fragments : {1, 3, 8, 63, kBatchFragments}) {
        const FragmentBatch batch = MakeBatch(scene, random, fragments);
        for (const std::string& name : VectorSets()) {
          const ShadeKernels& kernels = ShadeKernelsNamed(name);
          FragmentBatch placed = batch;
          ExpectPlaced(kernels, placed);
#define VOXELPIPE_SHADE(shader) shaded += ExpectShaded(kernels, FragmentShaderId::k##shader, placed);
          VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_SHADE)
#undef VOXELPIPE_SHADE
          if (HasFailure()) return;
        }
      }
    }
  }
  if (!VectorSets().empty()) {
    EXPECT_GT(shaded, 5000);
  }
}

TEST(ShadeKernels, VectorsConvertAsTheScalarFunctions) {
  const float infinity = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> odd = {0,      -0.0f,   1,     -1,       0.5f,      1.5f,  2.5f,
                                  254.5f, 255.4f,  300,   65534.5f, 65535.5f,  1e10f, -1e10f,
                                  1e-42f, 3.4e38f, 1e-8f, infinity, -infinity, nan,   0.25f};
  ShadedBatch shaded;
  for (int i = 0; i < kBatchFragments; ++i) {
    for (int c = 0; c < 4; ++c) {
      shaded.f[c][i] = odd[size_t(i * 3 + c) % odd.size()];
      shaded.u[c][i] = uint32_t(i * c) * 12345677u;
    }
  }
  for (const std::string& name : VectorSets()) {
    const ShadeKernels& kernels = ShadeKernelsNamed(name);
    for (const VoxelFormat format :
         {VoxelFormat::kU8, VoxelFormat::kU16, VoxelFormat::kU32, VoxelFormat::kF16, VoxelFormat::kF32,
          VoxelFormat::kU8Srgb, VoxelFormat::kU8Snorm, VoxelFormat::kU16Snorm}) {
      for (const bool is_u32 : {false, true}) {
        for (const double scale : {1.0, 255.0, 0.01}) {
          const ConversionRules rules{format, is_u32, 4, scale, 0x1p-20 * scale};
          BatchCells cells = {}, expected_cells = {};
          BatchTerms terms = {}, expected_terms = {};
          kernels.to_cells(shaded, kBatchFragments, rules, cells);
          ToCellsOneByOne(shaded, kBatchFragments, rules, expected_cells);
          kernels.to_terms(shaded, kBatchFragments, rules, terms);
          ToTermsOneByOne(shaded, kBatchFragments, rules, expected_terms);
          for (int i = 0; i < kBatchFragments; ++i) {
            for (int c = 0; c < 4; ++c) {
              ASSERT_EQ(cells[c][i], expected_cells[c][i]) << int(format) << ", " << shaded.f[c][i];
              ASSERT_EQ(terms[c][i], expected_terms[c][i]) << int(format) << ", " << shaded.f[c][i];
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace voxelpipe::cpu
