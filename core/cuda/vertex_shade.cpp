// Vertex shading and the mesh's way to the device.
//
// Vertices are shaded by the host's stage, which also finds the box and names bad vertices: a vertex shader runs once a vertex, and
// poses are made of host data. The device gets the shaded arrays.
#include <string>

#include "absl/strings/str_cat.h"
#include "cuda/mesh_cache.h"
#include "cuda/mesh_uploads.h"
#include "cuda/run_state.h"
#include "mesh/content_id.h"
#include "shaders/mips.h"

namespace voxelpipe::cuda {
namespace {

// Uploads an array where it is wanted; `view` becomes its address on the device. `kept`: it is the mesh's own, as it was loaded, and
// `part` says which of its arrays: where the mesh has an id the device may have it already.
template <typename T>
absl::Status UploadIf(RunState& state, bool wanted, bool kept, const char* part, const T* from, uint64_t count,
                      DeviceArray<T>& to, const T*& view) {
  view = nullptr;
  if (!wanted || from == nullptr) return absl::OkStatus();
  const SharedArrays shared = SharedArraysOf(state.host.mesh.content_id);
  if (kept && !shared.id.empty() && count > 0) {
    auto array = CachedUpload(state.device.ordinal, absl::StrCat(shared.id, "/", part), from, count * sizeof(T),
                              state.stream, state.staged);
    if (!array.ok()) return array.status();
    view = reinterpret_cast<const T*>((*array)->data());
    state.cached.push_back(*std::move(array));
    return absl::OkStatus();
  }
  VOXELPIPE_OK_OR_RETURN(to.Resize(count, state.stream));
  VOXELPIPE_OK_OR_RETURN(StagedCopy(to.data(), from, count * sizeof(T), state.stream, state.staged));
  CountMeshUpload(state.device.ordinal, count * sizeof(T));
  view = to.data();
  return absl::OkStatus();
}

absl::Status UploadTextures(RunState& state) {
  const cpu::RunState& host = state.host;
  DeviceMesh& mesh = state.mesh;
  std::vector<TextureView> textures = host.textures;
  mesh.images.resize(textures.size());
  mesh.mips.resize(textures.size());
  for (size_t i = 0; i < textures.size(); ++i) {
    TextureView& t = textures[i];
    if (t.rgba == nullptr) continue;
    // A texture stands in the list twice, as linear values and as sRGB colours: of one image.
    if (i > 0 && host.textures[i - 1].rgba == t.rgba) {
      t.rgba = textures[i - 1].rgba;
    } else {
      VOXELPIPE_OK_OR_RETURN(mesh.images[i].Upload({t.rgba, uint64_t{t.width} * t.height * 4}, state.stream));
      t.rgba = mesh.images[i].data();
    }
    if (t.mips == nullptr) continue;
    VOXELPIPE_OK_OR_RETURN(mesh.mips[i].Upload({t.mips, LevelOffset(t.width, t.height, t.levels)}, state.stream));
    t.mips = mesh.mips[i].data();
  }
  VOXELPIPE_OK_OR_RETURN(mesh.textures.Upload(textures, state.stream));
  mesh.host_view.textures = mesh.textures.data();
  return absl::OkStatus();
}

absl::Status UploadAttributes(RunState& state) {
  DeviceMesh& mesh = state.mesh;
  std::vector<AttributeView> attributes = state.host.attributes;
  mesh.attribute_values.resize(attributes.size());
  for (size_t i = 0; i < attributes.size(); ++i) {
    const uint64_t count = state.host.view.vertex_count * uint64_t(attributes[i].components);
    const std::string part = absl::StrCat("attribute", i);
    VOXELPIPE_OK_OR_RETURN(UploadIf(state, true, true, part.c_str(), attributes[i].values, count,
                                    mesh.attribute_values[i], attributes[i].values));
  }
  VOXELPIPE_OK_OR_RETURN(mesh.attributes.Upload(attributes, state.stream));
  mesh.host_view.attributes = mesh.attributes.data();
  return absl::OkStatus();
}

// Whether any fragment shader looks at more than which voxels a triangle touches.
bool AnyShading(const BoundRequest& request) {
  for (const BoundShader& shader : request.fragment_shaders) {
    if (FragmentShaderId(shader.id) != FragmentShaderId::kOccupancy) return true;
  }
  return false;
}

}  // namespace

absl::Status UploadMesh(RunState& state) {
  const MeshView& host = state.host.view;
  DeviceMesh& mesh = state.mesh;
  const bool shading = AnyShading(state.request);
  mesh.host_view = host;
  const uint64_t n = host.vertex_count;
  const TriangleMesh& own = state.host.mesh;
  MeshView& there = mesh.host_view;
  const auto upload = [&](bool wanted, bool kept, const char* part, const auto* from, uint64_t count, auto& to,
                          auto& view) { return UploadIf(state, wanted, kept, part, from, count, to, view); };
  const auto is_own = [](const auto* shaded, const auto& array) { return shaded == array.data(); };
  // Of a mesh that was moved all else may be there.
  const bool kept_positions = is_own(host.positions, own.positions) && SharedArraysOf(own.content_id).positions;
  VOXELPIPE_OK_OR_RETURN(upload(true, kept_positions, "positions", host.positions, n, mesh.positions, there.positions));
  const uint32_t* triangles = nullptr;
  VOXELPIPE_OK_OR_RETURN(upload(true, true, "triangles", host.triangles == nullptr ? nullptr : &host.triangles[0][0],
                                host.triangle_count * 3, mesh.triangles, triangles));
  there.triangles = reinterpret_cast<const uint32_t(*)[3]>(triangles);
  VOXELPIPE_OK_OR_RETURN(
      upload(shading, is_own(host.normals, own.normals), "normals", host.normals, n, mesh.normals, there.normals));
  VOXELPIPE_OK_OR_RETURN(upload(shading, is_own(host.tangents, own.tangents), "tangents", host.tangents, n,
                                mesh.tangents, there.tangents));
  VOXELPIPE_OK_OR_RETURN(upload(shading, false, "velocities", host.velocities, n, mesh.velocities, there.velocities));
  VOXELPIPE_OK_OR_RETURN(upload(shading, true, "colors", host.colors, n, mesh.colors, there.colors));
  VOXELPIPE_OK_OR_RETURN(upload(shading, true, "uv0", host.uv[0], n, mesh.uv[0], there.uv[0]));
  VOXELPIPE_OK_OR_RETURN(upload(shading, true, "uv1", host.uv[1], n, mesh.uv[1], there.uv[1]));
  VOXELPIPE_OK_OR_RETURN(upload(true, false, "parts", host.parts, host.part_count, mesh.parts, there.parts));
  VOXELPIPE_OK_OR_RETURN(
      upload(shading, false, "materials", host.materials, host.material_count, mesh.materials, there.materials));
  if (shading) {
    VOXELPIPE_OK_OR_RETURN(UploadTextures(state));
    VOXELPIPE_OK_OR_RETURN(UploadAttributes(state));
  }
  mesh.host_view.index_positions = nullptr;  // CoarseRaster makes them, and uploads the view
  mesh.view.Free();
  return absl::OkStatus();
}

absl::StatusOr<MeshExtent> VertexShade(RunState& state) {
  absl::StatusOr<MeshExtent> extent = cpu::VertexShade(state.host);
  if (!extent.ok()) return extent.status();
  state.box = extent->box;
  VOXELPIPE_OK_OR_RETURN(UploadMesh(state));
  return extent;
}

}  // namespace voxelpipe::cuda
