#include "mesh/health/check_mesh.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "mesh/views/mips.h"

namespace voxelpipe {
namespace {

constexpr size_t kGrain = 1 << 15;

absl::Status Broken(const char* what) {
  return absl::InvalidArgumentError(absl::StrCat("mesh: ", what));
}

template <typename T>
bool NoneOr(const std::vector<T>& values, uint64_t count) {
  return values.empty() || values.size() == count;
}

bool IsRef(int64_t index, uint64_t count) {
  return index >= -1 && (index < 0 || uint64_t(index) < count);
}

bool IndicesBelow(const std::vector<std::array<uint32_t, 3>>& triangles, uint64_t vertices) {
  const auto most = [&](size_t begin, size_t end) {
    uint32_t m = 0;
    const uint32_t* const flat = triangles.data()->data();
    for (size_t i = 3 * begin; i < 3 * end; ++i) m = std::max(m, flat[i]);
    return m;
  };
  if (triangles.empty()) return true;
  if (triangles.size() <= kGrain) return most(0, triangles.size()) < vertices;
  const uint32_t m = tbb::parallel_reduce(
      tbb::blocked_range<size_t>(0, triangles.size(), kGrain), uint32_t{0},
      [&](const auto& range, uint32_t so_far) { return std::max(so_far, most(range.begin(), range.end())); },
      [](uint32_t a, uint32_t b) { return std::max(a, b); });
  return m < vertices;
}

// Without branches: the number of exponents that mean "not finite".
bool Finite(const std::vector<Vec3d>& positions) {
  const auto finite = [&](size_t begin, size_t end) {
    constexpr uint64_t kExponent = uint64_t{0x7ff} << 52;
    uint64_t bad = 0;
    for (size_t i = begin; i < end; ++i) {
      const Vec3d& p = positions[i];
      for (const double c : {p.x, p.y, p.z}) bad |= (std::bit_cast<uint64_t>(c) & kExponent) == kExponent ? 1u : 0u;
    }
    return bad == 0;
  };
  if (positions.size() <= kGrain) return finite(0, positions.size());
  std::atomic<bool> all{true};
  tbb::parallel_for(tbb::blocked_range<size_t>(0, positions.size(), kGrain), [&](const auto& range) {
    if (!finite(range.begin(), range.end())) all = false;
  });
  return all;
}

bool Covers(const TriangleMesh& mesh) {
  uint64_t triangles = 0, vertices = 0;
  for (const MeshPart& part : mesh.parts) {
    if (part.first_triangle != triangles || part.first_vertex != vertices) return false;
    if (part.triangle_count > mesh.triangles.size() - triangles) return false;
    if (part.vertex_count > mesh.positions.size() - vertices) return false;
    triangles += part.triangle_count;
    vertices += part.vertex_count;
    if (!IsRef(part.material, mesh.materials.size())) return false;
    const bool there = (!part.has_normals || !mesh.normals.empty()) && (!part.has_tangents || !mesh.tangents.empty()) &&
                       (!part.has_colors || !mesh.colors.empty()) && (!part.has_uv[0] || !mesh.uv[0].empty()) &&
                       (!part.has_uv[1] || !mesh.uv[1].empty());
    if (part.vertex_count > 0 && !there) return false;
  }
  return triangles == mesh.triangles.size() && vertices == mesh.positions.size();
}

bool AreUnused(const std::vector<uint32_t>& unused, uint64_t vertices) {
  for (size_t i = 0; i < unused.size(); ++i) {
    if (unused[i] >= vertices || (i > 0 && unused[i] <= unused[i - 1])) return false;
  }
  return true;
}

// Values of all vertices, or of those of the runs. `vertices` are 32 bits.
bool IsOwnAttribute(const VertexAttribute& attribute, uint64_t vertices) {
  if (attribute.components < 1 || attribute.components > 4) return false;
  const uint64_t components = uint64_t(attribute.components);
  if (attribute.runs.empty()) return attribute.values.size() == vertices * components;
  uint64_t end = 0, values = 0;
  for (const AttributeRun& run : attribute.runs) {
    if (run.first_vertex < end || run.end_vertex < run.first_vertex || run.end_vertex > vertices) return false;
    if (run.first_value != values) return false;
    end = run.end_vertex;
    values += (run.end_vertex - run.first_vertex) * components;
  }
  return attribute.values.size() == values;
}

// Shaders rely on all vertices of a triangle having values, or none. For parts that cover the mesh.
bool StayInParts(const TriangleMesh& mesh) {
  std::atomic<bool> all{true};
  tbb::parallel_for(size_t{0}, mesh.parts.size(), [&](size_t p) {
    const MeshPart& part = mesh.parts[p];
    for (uint64_t t = part.first_triangle; t < part.first_triangle + part.triangle_count; ++t) {
      for (const uint32_t v : mesh.triangles[t]) {
        if (v < part.first_vertex || v - part.first_vertex >= part.vertex_count) all = false;
      }
    }
  });
  return all;
}

absl::Status CheckArrays(const TriangleMesh& mesh) {
  const uint64_t vertices = mesh.positions.size();
  if (vertices > UINT32_MAX) return Broken("it has more vertices than 32-bit indices can name");
  if (!NoneOr(mesh.normals, vertices) || !NoneOr(mesh.tangents, vertices) || !NoneOr(mesh.colors, vertices) ||
      !NoneOr(mesh.uv[0], vertices) || !NoneOr(mesh.uv[1], vertices)) {
    return Broken("normals, tangents, uv or colors: neither empty nor as long as positions");
  }
  bool runs = false;
  for (const VertexAttribute& attribute : mesh.attributes) {
    if (!IsOwnAttribute(attribute, vertices))
      return Broken("attributes: the values of one are not those of its vertices");
    runs = runs || !attribute.runs.empty();
  }
  if (!IndicesBelow(mesh.triangles, vertices)) return Broken("triangles: an index is not below positions.size()");
  if (!Finite(mesh.positions)) return Broken("positions: one is not finite");
  if (mesh.unused_vertices && !AreUnused(*mesh.unused_vertices, vertices))
    return Broken("unused_vertices: they are not ids of vertices in ascending order");
  if (!Covers(mesh))
    return Broken(
        "parts: they do not cover all triangles and vertices in order, once each, with materials and arrays that "
        "exist");
  if (runs && !StayInParts(mesh)) return Broken("parts: a triangle has vertices of several");
  return absl::OkStatus();
}

bool IsImage(const Image& image) {
  const auto empty = [&] { return image.rgba.empty() && image.linear_mips.empty() && image.srgb_mips.empty(); };
  if (image.width == 0 || image.height == 0) return empty();
  const uint64_t texels = uint64_t{image.width} * image.height;
  if (image.rgba.empty() ? !empty() : texels > UINT64_MAX / 4 || image.rgba.size() != texels * 4) return false;
  if (image.rgba.empty()) return true;
  const uint64_t smaller = LevelOffset(image.width, image.height, CountLevels(image.width, image.height));
  return NoneOr(image.linear_mips, smaller) && NoneOr(image.srgb_mips, smaller);
}

bool IsMorph(const MorphData& morph) {
  const uint64_t vertices = morph.positions.size();
  if (!NoneOr(morph.normals, vertices) || !NoneOr(morph.tangents, vertices)) return false;
  return std::all_of(morph.targets.begin(), morph.targets.end(), [&](const MorphTarget& target) {
    return NoneOr(target.positions, vertices) && NoneOr(target.normals, vertices) && NoneOr(target.tangents, vertices);
  });
}

// A primitive of a rig, which has as many vertices as its parts.
bool IsPrimitive(const Primitive& primitive, uint64_t vertices) {
  const MorphData* const morph = primitive.morph.get();
  if ((morph != nullptr ? morph->positions : primitive.positions).size() != vertices) return false;
  if (morph != nullptr && !IsMorph(*morph)) return false;
  if (!NoneOr(primitive.normals, vertices) || !NoneOr(primitive.tangents, vertices)) return false;
  for (int set = 0; set < 2; ++set) {
    if (!NoneOr(primitive.joints[set], vertices) || !NoneOr(primitive.weights[set], vertices)) return false;
  }
  return true;
}

bool IsSampler(const AnimationSampler& sampler) {
  if (sampler.times.empty() || sampler.width == 0) return false;
  for (size_t i = 0; i < sampler.times.size(); ++i) {
    if (!std::isfinite(sampler.times[i]) || (i > 0 && !(sampler.times[i] > sampler.times[i - 1]))) return false;
  }
  const uint64_t a_key = sampler.width * uint64_t{sampler.interpolation == Interpolation::kCubicSpline ? 3u : 1u};
  return sampler.values.size() % a_key == 0 && sampler.values.size() / a_key == sampler.times.size();
}

bool IsAnimation(const Animation& animation, uint64_t nodes) {
  if (!animation.fault.ok()) return true;  // a fault of its own: it cannot be played
  if (!std::all_of(animation.samplers.begin(), animation.samplers.end(), IsSampler)) return false;
  return std::all_of(animation.channels.begin(), animation.channels.end(), [&](const AnimationChannel& channel) {
    if (channel.node >= nodes || channel.sampler >= animation.samplers.size()) return false;
    const uint32_t width = animation.samplers[channel.sampler].width;
    switch (channel.path) {
      case AnimationPath::kTranslation:
      case AnimationPath::kScale: return width == 3;
      case AnimationPath::kRotation: return width == 4;
      case AnimationPath::kWeights: return true;
    }
    return false;
  });
}

// Every node once, after its parent.
bool IsOrder(const Rig& rig) {
  if (rig.order.size() != rig.nodes.size()) return false;
  std::vector<bool> seen(rig.nodes.size());
  for (const uint32_t n : rig.order) {
    if (n >= rig.nodes.size() || seen[n]) return false;
    const int64_t parent = rig.nodes[n].parent;
    if (!IsRef(parent, rig.nodes.size()) || (parent >= 0 && !seen[size_t(parent)])) return false;
    seen[n] = true;
  }
  return true;
}

absl::Status CheckRig(const Rig& rig, const TriangleMesh& mesh) {
  if (!IsOrder(rig)) return Broken("rig: order does not have each node once, after its parent");
  for (const Skin& skin : rig.skins) {
    if (skin.joints.size() != skin.inverse_bind_matrices.size())
      return Broken("rig: a skin has not one inverse bind matrix for each joint");
    for (const uint32_t joint : skin.joints) {
      if (joint >= rig.nodes.size()) return Broken("rig: a joint is no node");
    }
  }
  for (const Animation& animation : rig.animations) {
    if (!IsAnimation(animation, rig.nodes.size())) return Broken("rig: an animation has a wrong sampler or channel");
  }
  if (rig.parts.size() != mesh.parts.size()) return Broken("rig: it has not as many parts as the mesh");
  const Primitive* last = nullptr;
  uint64_t last_vertices = 0;
  for (size_t i = 0; i < rig.parts.size(); ++i) {
    const RigPart& part = rig.parts[i];
    if (part.primitive == nullptr || part.node >= rig.nodes.size() || !IsRef(part.skin, rig.skins.size())) {
      return Broken("rig: a part has no primitive, or a node or skin that does not exist");
    }
    if (part.skin >= 0 && rig.skins[size_t(part.skin)].joints.empty()) return Broken("rig: a skin has no joints");
    const uint64_t vertices = mesh.parts[i].vertex_count;
    if (part.primitive.get() == last && vertices == last_vertices) continue;  // instances follow one another
    if (!IsPrimitive(*part.primitive, vertices))
      return Broken("rig: a primitive has another number of vertices than its part");
    last = part.primitive.get();
    last_vertices = vertices;
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckTextures(const TriangleMesh& mesh) {
  for (const Material& material : mesh.materials) {
    for (const TextureRef* ref : {&material.base_color, &material.emissive, &material.metallic_roughness}) {
      if (!IsRef(ref->texture, mesh.textures.size())) return Broken("materials: a texture does not exist");
    }
  }
  for (const Texture& texture : mesh.textures) {
    if (!IsRef(texture.image, mesh.images.size())) return Broken("textures: an image does not exist");
  }
  for (const auto& image : mesh.images) {
    if (image != nullptr && !IsImage(*image)) return Broken("images: one has not as many texels as its size says");
  }
  return absl::OkStatus();
}

absl::Status CheckMesh(const TriangleMesh& mesh) {
  if (absl::Status s = CheckArrays(mesh); !s.ok()) return s;
  if (absl::Status s = CheckTextures(mesh); !s.ok()) return s;
  return mesh.rig == nullptr ? absl::OkStatus() : CheckRig(*mesh.rig, mesh);
}

}  // namespace voxelpipe
