#include "cuda/batch_mesh.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "cuda/mesh_uploads.h"
#include "cuda/run_state.h"
#include "mesh/content_id.h"
#include "shaders/mips.h"

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

// An empty key: the device does not keep it.
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
  view_ = host;
  by_tiles_ = !member.by_rows;
  const bool has_id = !shared.id.empty() && !mesh.triangles.empty();
  const bool own_positions = host.positions == mesh.positions.data() && shared.positions;
  VOXELPIPE_OK_OR_RETURN(AddArray(has_id && own_positions ? shared.id + "/positions" : "", host.positions,
                                  host.vertex_count, kept, layout, positions_));
  VOXELPIPE_OK_OR_RETURN(AddArray(has_id ? shared.id + "/triangles" : "",
                                  host.triangles == nullptr ? nullptr : &host.triangles[0][0], 3 * host.triangle_count,
                                  kept, layout, triangles_));
  if (!by_tiles_) return absl::OkStatus();
  AddToBlock(host.parts, host.part_count, layout, parts_);
  if (AnyShading(*member.bound)) VOXELPIPE_OK_OR_RETURN(AddShading(member, kept, layout));
  view_at_ = layout.Add(&view_, 1);
  return absl::OkStatus();
}

absl::Status BatchMesh::AddShading(const BatchMember& member, KeptArrays& kept, UploadLayout& layout) {
  const TriangleMesh& mesh = *member.item->mesh;
  const std::string id = mesh.triangles.empty() ? "" : SharedArraysOf(mesh.content_id).id;
  const MeshView& host = member.host->view;
  const uint64_t n = host.vertex_count;
  // Of the mesh itself, or made by the vertex shader.
  const auto key = [&](const char* part, bool own) { return id.empty() || !own ? "" : absl::StrCat(id, "/", part); };
  VOXELPIPE_OK_OR_RETURN(
      AddArray(key("normals", host.normals == mesh.normals.data()), host.normals, n, kept, layout, normals_));
  VOXELPIPE_OK_OR_RETURN(
      AddArray(key("tangents", host.tangents == mesh.tangents.data()), host.tangents, n, kept, layout, tangents_));
  VOXELPIPE_OK_OR_RETURN(AddArray("", host.velocities, n, kept, layout, velocities_));
  VOXELPIPE_OK_OR_RETURN(AddArray(key("colors", true), host.colors, n, kept, layout, colors_));
  VOXELPIPE_OK_OR_RETURN(AddArray(key("uv0", true), host.uv[0], n, kept, layout, uv_[0]));
  VOXELPIPE_OK_OR_RETURN(AddArray(key("uv1", true), host.uv[1], n, kept, layout, uv_[1]));
  AddToBlock(host.materials, host.material_count, layout, materials_);
  attribute_list_ = member.host->attributes;
  values_.resize(attribute_list_.size());
  for (size_t i = 0; i < attribute_list_.size(); ++i) {
    const uint64_t count = n * uint64_t(attribute_list_[i].components);
    VOXELPIPE_OK_OR_RETURN(AddArray(key(absl::StrCat("attribute", i).c_str(), true), attribute_list_[i].values, count,
                                    kept, layout, values_[i]));
  }
  AddToBlock(attribute_list_.data(), attribute_list_.size(), layout, attributes_);
  texture_list_ = member.host->textures;
  AddTextures(layout);
  return absl::OkStatus();
}

void BatchMesh::AddTextures(UploadLayout& layout) {
  images_.resize(texture_list_.size());
  mips_.resize(texture_list_.size());
  for (size_t i = 0; i < texture_list_.size(); ++i) {
    const TextureView& t = texture_list_[i];
    if (t.rgba == nullptr) continue;
    // A texture stands in the list twice, as linear values and as sRGB colours: of one image.
    if (i > 0 && texture_list_[i - 1].rgba == t.rgba) {
      images_[i] = images_[i - 1];
    } else {
      AddToBlock(t.rgba, uint64_t{t.width} * t.height * 4, layout, images_[i]);
    }
    if (t.mips != nullptr) AddToBlock(t.mips, LevelOffset(t.width, t.height, t.levels), layout, mips_[i]);
  }
  AddToBlock(texture_list_.data(), texture_list_.size(), layout, textures_);
}

void BatchMesh::Place(const uint8_t* block, const Vec3d* index_positions) {
  view_.positions = positions_.On(block);
  view_.triangles = reinterpret_cast<const uint32_t(*)[3]>(triangles_.On(block));
  if (!by_tiles_) return;
  view_.index_positions = index_positions;
  view_.normals = normals_.On(block);
  view_.tangents = tangents_.On(block);
  view_.velocities = velocities_.On(block);
  view_.colors = colors_.On(block);
  for (int set = 0; set < 2; ++set) view_.uv[set] = uv_[set].On(block);
  view_.parts = parts_.On(block);
  view_.materials = materials_.On(block);
  view_.textures = textures_.On(block);
  view_.attributes = attributes_.On(block);
  for (size_t i = 0; i < texture_list_.size(); ++i) {
    texture_list_[i].rgba = images_[i].On(block);
    texture_list_[i].mips = mips_[i].On(block);
  }
  for (size_t i = 0; i < attribute_list_.size(); ++i) attribute_list_[i].values = values_[i].On(block);
  there_ = reinterpret_cast<const MeshView*>(block + view_at_);
}

}  // namespace voxelpipe::cuda
