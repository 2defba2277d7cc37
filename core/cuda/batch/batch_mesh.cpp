// Collects the mesh arrays of a member for upload, or finds them in the device's mesh cache.
#include "cuda/batch/batch_mesh.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "cuda/device/mesh_uploads.h"
#include "cuda/run/run_state.h"
#include "mesh/content_id.h"
#include "mesh/views/mips.h"

namespace voxelpipe::cuda {

absl::StatusOr<const uint8_t*> KeptArrays::Find(const std::string& key, const void* from, uint64_t bytes) {
  auto array = CachedUpload(ordinal_, key, from, bytes, stream_, staged_);
  if (!array.ok()) return array.status();
  arrays_.push_back(*std::move(array));
  return arrays_.back()->data();
}

template <typename T>
void BatchMesh::AddToBlock(const T* from, uint64_t count, UploadLayout& layout, Array<T>& array) {
  if (from == nullptr) return;
  array.in_block = true;
  array.at = layout.Add(from, count);
}

// An empty key: the array is not cached on the device.
template <typename T>
absl::Status BatchMesh::AddArray(const std::string& key, const T* from, uint64_t count, KeptArrays& kept,
                                 UploadLayout& layout, Array<T>& array) {
  if (from == nullptr) return absl::OkStatus();
  if (key.empty() || count == 0) {
    AddToBlock(from, count, layout, array);
    CountMeshUpload(kept.ordinal(), count * sizeof(T));
    return absl::OkStatus();
  }
  const absl::StatusOr<const uint8_t*> there = kept.Find(key, from, count * sizeof(T));
  if (!there.ok()) return there.status();
  array.kept = reinterpret_cast<const T*>(*there);
  return absl::OkStatus();
}

absl::Status BatchMesh::Add(const BatchMember& member, KeptArrays& kept, UploadLayout& layout) {
  const TriangleMesh& mesh = *member.item->mesh;
  const SharedArrays shared = SharedArraysOf(mesh.content_id);
  const MeshView& host = member.host->view;
  const bool has_id = !shared.id.empty() && !mesh.triangles.empty();
  const bool own_positions = host.positions == mesh.positions.data() && shared.positions;
  VOXELPIPE_OK_OR_RETURN(AddArray(has_id && own_positions ? shared.id + "/positions" : "", host.positions,
                                  host.vertex_count, kept, layout, positions_));
  VOXELPIPE_OK_OR_RETURN(AddArray(has_id ? shared.id + "/triangles" : "",
                                  host.triangles == nullptr ? nullptr : &host.triangles[0][0], 3 * host.triangle_count,
                                  kept, layout, triangles_));
  const bool shades =
      member.path == BatchPath::kFragments ? ShadesFragments(*member.bound) : member.path != BatchPath::kRows;
  return shades ? AddShading(member, kept, layout) : absl::OkStatus();
}

absl::Status BatchMesh::AddShading(const BatchMember& member, KeptArrays& kept, UploadLayout& layout) {
  const TriangleMesh& mesh = *member.item->mesh;
  const std::string id = mesh.triangles.empty() ? "" : SharedArraysOf(mesh.content_id).id;
  const MeshView& host = member.host->view;
  const uint64_t n = host.vertex_count;
  shading_ = std::make_unique<Shading>();
  Shading& s = *shading_;
  s.view = host;
  s.view_at = layout.Add(&s.view, 1);
  AddToBlock(host.parts, host.part_count, layout, s.parts);
  if (!AnyShading(*member.bound)) return absl::OkStatus();
  // `own`: an array of the mesh itself; otherwise the vertex shader computed it.
  const auto key = [&](const std::string& part, bool own) {
    return id.empty() || !own ? "" : absl::StrCat(id, "/", part);
  };
  VOXELPIPE_OK_OR_RETURN(
      AddArray(key("normals", host.normals == mesh.normals.data()), host.normals, n, kept, layout, s.normals));
  VOXELPIPE_OK_OR_RETURN(
      AddArray(key("tangents", host.tangents == mesh.tangents.data()), host.tangents, n, kept, layout, s.tangents));
  VOXELPIPE_OK_OR_RETURN(AddArray("", host.velocities, n, kept, layout, s.velocities));
  VOXELPIPE_OK_OR_RETURN(AddArray(key("colors", true), host.colors, n, kept, layout, s.colors));
  VOXELPIPE_OK_OR_RETURN(AddArray(key("uv0", true), host.uv[0], n, kept, layout, s.uv[0]));
  VOXELPIPE_OK_OR_RETURN(AddArray(key("uv1", true), host.uv[1], n, kept, layout, s.uv[1]));
  AddToBlock(host.materials, host.material_count, layout, s.materials);
  s.attribute_list = member.host->attributes;
  s.values.resize(s.attribute_list.size());
  s.runs.resize(s.attribute_list.size());
  for (size_t i = 0; i < s.attribute_list.size(); ++i) {
    const uint64_t count = ValueCount(s.attribute_list[i], n);
    VOXELPIPE_OK_OR_RETURN(AddArray(key(absl::StrCat("attribute", i), true), s.attribute_list[i].values, count, kept,
                                    layout, s.values[i]));
    AddToBlock(s.attribute_list[i].runs, s.attribute_list[i].run_count, layout, s.runs[i]);
  }
  AddToBlock(s.attribute_list.data(), s.attribute_list.size(), layout, s.attributes);
  s.texture_list = member.host->textures;
  AddTextures(layout);
  return absl::OkStatus();
}

void BatchMesh::AddTextures(UploadLayout& layout) {
  Shading& s = *shading_;
  s.images.resize(s.texture_list.size());
  s.mips.resize(s.texture_list.size());
  for (size_t i = 0; i < s.texture_list.size(); ++i) {
    const TextureView& t = s.texture_list[i];
    if (t.rgba == nullptr) continue;
    // A texture is listed twice, as linear values and as sRGB colours, with one image.
    if (i > 0 && s.texture_list[i - 1].rgba == t.rgba) {
      s.images[i] = s.images[i - 1];
    } else {
      AddToBlock(t.rgba, uint64_t{t.width} * t.height * 4, layout, s.images[i]);
    }
    if (t.mips != nullptr) AddToBlock(t.mips, LevelOffset(t.width, t.height, t.levels), layout, s.mips[i]);
  }
  AddToBlock(s.texture_list.data(), s.texture_list.size(), layout, s.textures);
}

void BatchMesh::Place(const uint8_t* block, const Vec3d* index_positions, const std::array<int64_t, 3>& grid_dims) {
  positions_there_ = positions_.On(block);
  triangles_there_ = triangles_.On(block);
  if (shading_) PlaceShading(block, index_positions, grid_dims);
}

void BatchMesh::PlaceShading(const uint8_t* block, const Vec3d* index_positions,
                             const std::array<int64_t, 3>& grid_dims) {
  Shading& s = *shading_;
  s.view.positions = positions_there_;
  s.view.triangles = reinterpret_cast<const uint32_t(*)[3]>(triangles_there_);
  s.view.index_positions = index_positions;
  std::copy_n(grid_dims.data(), 3, s.view.grid_dims);
  s.view.normals = s.normals.On(block);
  s.view.tangents = s.tangents.On(block);
  s.view.velocities = s.velocities.On(block);
  s.view.colors = s.colors.On(block);
  for (int set = 0; set < 2; ++set) s.view.uv[set] = s.uv[set].On(block);
  s.view.parts = s.parts.On(block);
  s.view.materials = s.materials.On(block);
  s.view.textures = s.textures.On(block);
  s.view.attributes = s.attributes.On(block);
  for (size_t i = 0; i < s.texture_list.size(); ++i) {
    s.texture_list[i].rgba = s.images[i].On(block);
    s.texture_list[i].mips = s.mips[i].On(block);
  }
  for (size_t i = 0; i < s.attribute_list.size(); ++i) {
    s.attribute_list[i].values = s.values[i].On(block);
    if (s.attribute_list[i].run_count > 0) s.attribute_list[i].runs = s.runs[i].On(block);
  }
  view_there_ = reinterpret_cast<const MeshView*>(block + s.view_at);
}

}  // namespace voxelpipe::cuda
