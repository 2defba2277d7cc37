// Vertex shading and the mesh's way to the device.
//
// Vertices are shaded by the host's stage, which also finds the box and names bad vertices: a vertex shader runs once a vertex, and
// poses are made of host data. The device gets the shaded arrays.
#include <span>

#include "cuda/run_state.h"
#include "shaders/mips.h"

namespace voxelpipe::cuda {
namespace {

template <typename T>
absl::Status UploadIf(bool wanted, const T* from, uint64_t count, DeviceArray<T>& to, const T*& view,
                      cudaStream_t stream) {
  view = nullptr;
  if (!wanted || from == nullptr) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(to.Upload({from, count}, stream));
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
    VOXELPIPE_OK_OR_RETURN(mesh.attribute_values[i].Upload({attributes[i].values, count}, state.stream));
    attributes[i].values = mesh.attribute_values[i].data();
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
  VOXELPIPE_OK_OR_RETURN(UploadIf(true, host.positions, n, mesh.positions, mesh.host_view.positions, state.stream));
  const uint32_t* triangles = nullptr;
  VOXELPIPE_OK_OR_RETURN(UploadIf(true, host.triangles == nullptr ? nullptr : &host.triangles[0][0],
                                  host.triangle_count * 3, mesh.triangles, triangles, state.stream));
  mesh.host_view.triangles = reinterpret_cast<const uint32_t(*)[3]>(triangles);
  VOXELPIPE_OK_OR_RETURN(UploadIf(shading, host.normals, n, mesh.normals, mesh.host_view.normals, state.stream));
  VOXELPIPE_OK_OR_RETURN(UploadIf(shading, host.tangents, n, mesh.tangents, mesh.host_view.tangents, state.stream));
  VOXELPIPE_OK_OR_RETURN(
      UploadIf(shading, host.velocities, n, mesh.velocities, mesh.host_view.velocities, state.stream));
  VOXELPIPE_OK_OR_RETURN(UploadIf(shading, host.colors, n, mesh.colors, mesh.host_view.colors, state.stream));
  for (int i = 0; i < 2; ++i) {
    VOXELPIPE_OK_OR_RETURN(UploadIf(shading, host.uv[i], n, mesh.uv[i], mesh.host_view.uv[i], state.stream));
  }
  VOXELPIPE_OK_OR_RETURN(UploadIf(true, host.parts, host.part_count, mesh.parts, mesh.host_view.parts, state.stream));
  VOXELPIPE_OK_OR_RETURN(
      UploadIf(shading, host.materials, host.material_count, mesh.materials, mesh.host_view.materials, state.stream));
  if (shading) {
    VOXELPIPE_OK_OR_RETURN(UploadTextures(state));
    VOXELPIPE_OK_OR_RETURN(UploadAttributes(state));
  }
  mesh.host_view.index_positions = nullptr;  // CoarseRaster makes them, and uploads the view
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
