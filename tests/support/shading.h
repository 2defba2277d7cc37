// One triangle with every attribute, and the fragments of it, for the tests of shaders.
#pragma once

#include <algorithm>
#include <vector>

#include "gtest/gtest.h"
#include "shaders/catalog.h"
#include "shaders/interface/fragment_input.h"
#include "shaders/shader_list.h"

namespace voxelpipe::testing {

// Triangle (0,0,0), (4,0,0), (0,4,0) in world and index space alike, of one part with one material beside the default
// one. The view has no attributes until a test sets pointers and the part's flags.
struct ShadingScene {
  Vec3d positions[3] = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}};
  uint32_t triangle[1][3] = {{0, 1, 2}};
  PartView part;
  MaterialView materials[2];
  std::vector<TextureView> textures;

  MeshView View() const {
    MeshView view;
    view.positions = view.index_positions = positions;
    std::fill_n(view.grid_dims, 3, 8);
    view.triangles = triangle;
    view.parts = &part;
    view.materials = materials;
    view.textures = textures.data();
    view.vertex_count = 3;
    view.triangle_count = view.part_count = 1;
    view.material_count = 2;
    view.texture_count = uint32_t(textures.size());
    return view;
  }
};

// Binds `call` and shades one fragment; fails the test if it does not bind.
inline FragmentOutput ShadeOne(const MeshView& view, const ShaderCall& call, const Vec3f& barycentric,
                               const Vec3i& voxel = {0, 0, 0}, bool degenerate = false) {
  FragmentOutput out;
  const auto bound = BindShader(ShaderStage::kFragment, call);
  EXPECT_TRUE(bound.ok()) << bound.status();
  if (!bound.ok()) return out;
  FragmentInput in = MakeFragmentInput(view, 0, degenerate, bound->info->reads_textures);
  in.barycentric = barycentric;
  for (int a = 0; a < 3; ++a) in.voxel[a] = voxel[a];
  ShadeFragment(FragmentShaderId(bound->id), in, bound->params, out);
  return out;
}

inline Vec4f Floats(const FragmentOutput& out) {
  return {out.f[0], out.f[1], out.f[2], out.f[3]};
}

}  // namespace voxelpipe::testing
