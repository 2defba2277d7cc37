// Vertex shading, and upload of the mesh.
//
// The device shades: it reads the flattened arrays, uploaded or cached, and the shader's parameters. Poses are
// evaluated on the host with libm and uploaded (pose_upload.cpp). The host shades if the result is invalid, to name the
// vertex; and it measures small meshes that no shader changes, because it is faster than waiting for the device.
#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "absl/strings/str_cat.h"
#include "cuda/device/mesh_cache.h"
#include "cuda/device/mesh_uploads.h"
#include "cuda/vertex/vertex_shade.h"
#include "host_mesh/order_parts.h"
#include "host_mesh/surface_sums.h"
#include "mesh/content_id.h"
#include "mesh/views/mips.h"
#include "pipeline/plan/footprint_parts.h"

namespace voxelpipe::cuda {
namespace {

// Uploads an array if it is wanted and sets `view` to its device address. `kept`: it is an array of the loaded mesh,
// named by `part`, so if the mesh has an id the device may have it cached.
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

// Device addresses of host arrays: several textures may have one image.
using Uploaded = std::unordered_map<const void*, const void*>;

// Uploads texels, once, or finds them cached with the mesh (`kept`), and sets `texels` to their device address.
template <typename T>
absl::Status UploadTexels(RunState& state, bool kept, const std::string& part, uint64_t count, Uploaded& uploaded,
                          DeviceArray<T>& to, const T*& texels) {
  const auto [known, fresh] = uploaded.try_emplace(texels, nullptr);
  if (fresh) {
    const T* there = nullptr;
    VOXELPIPE_OK_OR_RETURN(UploadIf(state, true, kept, part.c_str(), texels, count, to, there));
    known->second = there;
  }
  texels = static_cast<const T*>(known->second);
  return absl::OkStatus();
}

uint64_t TexelBytes(const std::vector<TextureView>& textures) {
  uint64_t bytes = 0;
  for (const TextureView& t : textures) {
    if (t.rgba != nullptr) bytes += uint64_t{t.width} * t.height * 4;
    if (t.mips != nullptr) bytes += LevelOffset(t.width, t.height, t.levels) * sizeof(Vec4f);
  }
  return bytes;
}

absl::Status UploadTextures(RunState& state) {
  const HostMesh& host = state.host;
  DeviceMesh& mesh = state.mesh;
  std::vector<TextureView> textures = host.textures;
  mesh.images.resize(textures.size());
  mesh.mips.resize(textures.size());
  Uploaded uploaded;
  // More would evict the mesh itself and all others.
  const bool kept = TexelBytes(textures) <= MeshCacheBytes(state.device.ordinal) / 2;
  for (size_t i = 0; i < textures.size(); ++i) {
    TextureView& t = textures[i];
    if (t.rgba == nullptr) continue;
    // A texture is listed twice, as linear values and as sRGB colours, with one image.
    const int32_t image = host.mesh.textures[i / 2].image;
    VOXELPIPE_OK_OR_RETURN(UploadTexels(state, kept, absl::StrCat("image", image), uint64_t{t.width} * t.height * 4,
                                        uploaded, mesh.images[i], t.rgba));
    if (t.mips == nullptr) continue;
    VOXELPIPE_OK_OR_RETURN(UploadTexels(state, kept, absl::StrCat(t.srgb ? "srgb_mips" : "linear_mips", image),
                                        LevelOffset(t.width, t.height, t.levels), uploaded, mesh.mips[i], t.mips));
  }
  VOXELPIPE_OK_OR_RETURN(mesh.textures.Upload(textures, state.stream));
  mesh.host_view.textures = mesh.textures.data();
  return absl::OkStatus();
}

absl::Status UploadAttributes(RunState& state) {
  DeviceMesh& mesh = state.mesh;
  std::vector<AttributeView> attributes = state.host.attributes;
  mesh.attribute_values.resize(attributes.size());
  mesh.attribute_runs.resize(attributes.size());
  for (size_t i = 0; i < attributes.size(); ++i) {
    const uint64_t count = ValueCount(attributes[i], state.host.view.vertex_count);
    const std::string part = absl::StrCat("attribute", i);
    VOXELPIPE_OK_OR_RETURN(UploadIf(state, true, true, part.c_str(), attributes[i].values, count,
                                    mesh.attribute_values[i], attributes[i].values));
    if (attributes[i].run_count == 0) continue;
    const std::span<const AttributeRun> runs(attributes[i].runs, attributes[i].run_count);
    VOXELPIPE_OK_OR_RETURN(mesh.attribute_runs[i].Upload(runs, state.stream));
    attributes[i].runs = mesh.attribute_runs[i].data();
  }
  VOXELPIPE_OK_OR_RETURN(mesh.attributes.Upload(attributes, state.stream));
  mesh.host_view.attributes = mesh.attributes.data();
  return absl::OkStatus();
}

// True if positions depend on normals or tangents.
bool PositionsNeedNormals(VertexShaderId id) {
  switch (id) {
    case VertexShaderId::kDisplaceAlongNormal: return true;
    case VertexShaderId::kIdentity:
    case VertexShaderId::kTransform:
    case VertexShaderId::kMorph:
    case VertexShaderId::kSkin: return false;
  }
  return true;
}

// Arrays of the mesh that the stages or the vertex shader read on the device.
struct Wanted {
  bool positions = true, normals = false, tangents = false;
};

absl::Status UploadMesh(RunState& state, const Wanted& wanted) {
  const MeshView& host = state.host.view;
  DeviceMesh& mesh = state.mesh;
  const bool shading = AnyShading(state.request);
  mesh.host_view = host;
  const uint64_t n = host.vertex_count;
  MeshView& there = mesh.host_view;
  const auto upload = [&](bool wants, bool kept, const char* part, const auto* from, uint64_t count, auto& to,
                          auto& view) { return UploadIf(state, wants, kept, part, from, count, to, view); };
  // If the mesh was moved, its other arrays may still be cached.
  const bool kept_positions = SharedArraysOf(state.host.mesh.content_id).positions;
  mesh.as_loaded = true;
  VOXELPIPE_OK_OR_RETURN(
      upload(wanted.positions, kept_positions, "positions", host.positions, n, mesh.positions, there.positions));
  const uint32_t* triangles = nullptr;
  VOXELPIPE_OK_OR_RETURN(upload(true, true, "triangles", host.triangles == nullptr ? nullptr : &host.triangles[0][0],
                                host.triangle_count * 3, mesh.triangles, triangles));
  there.triangles = reinterpret_cast<const uint32_t(*)[3]>(triangles);
  VOXELPIPE_OK_OR_RETURN(upload(wanted.normals, true, "normals", host.normals, n, mesh.normals, there.normals));
  VOXELPIPE_OK_OR_RETURN(upload(wanted.tangents, true, "tangents", host.tangents, n, mesh.tangents, there.tangents));
  VOXELPIPE_OK_OR_RETURN(upload(shading, true, "colors", host.colors, n, mesh.colors, there.colors));
  VOXELPIPE_OK_OR_RETURN(upload(shading, true, "uv0", host.uv[0], n, mesh.uv[0], there.uv[0]));
  VOXELPIPE_OK_OR_RETURN(upload(shading, true, "uv1", host.uv[1], n, mesh.uv[1], there.uv[1]));
  VOXELPIPE_OK_OR_RETURN(upload(true, false, "parts", host.parts, host.part_count, mesh.parts, there.parts));
  VOXELPIPE_OK_OR_RETURN(
      upload(shading, false, "materials", host.materials, host.material_count, mesh.materials, there.materials));
  if (!state.parts.ids_in_order) VOXELPIPE_OK_OR_RETURN(OrderTriangles(state));
  if (shading) {
    VOXELPIPE_OK_OR_RETURN(UploadTextures(state));
    VOXELPIPE_OK_OR_RETURN(UploadAttributes(state));
  }
  mesh.host_view.index_positions = nullptr;  // set by CoarseRaster, which uploads the view
  mesh.view.Free();
  return absl::OkStatus();
}

// Memory for the shader's output: the uploaded array itself, or a new one if the input is cached.
template <typename T>
absl::Status MakeRoom(const RunState& state, DeviceArray<T>& to, T*& shaded) {
  VOXELPIPE_OK_OR_RETURN(to.Resize(state.host.view.vertex_count, state.stream));
  shaded = to.data();
  return absl::OkStatus();
}

// Uploads the mesh unless it is cached, and runs the vertex shader.
absl::Status ShadeOnDevice(RunState& state, const PosedMesh& posed, const VertexWork& work) {
  const MeshView& host = state.host.view;
  const auto shader = VertexShaderId(state.request.vertex_shader.id);
  const bool shading = AnyShading(state.request), poses = !posed.parts.empty();
  Wanted wanted;
  wanted.positions = !poses;
  wanted.normals = wanted.tangents = !poses && (shading || (work.places && PositionsNeedNormals(shader)));
  VOXELPIPE_OK_OR_RETURN(UploadMesh(state, wanted));
  DeviceMesh& mesh = state.mesh;
  MeshView& there = mesh.host_view;
  const bool moves = work.moves && shading;
  if (!work.places && !moves) return absl::OkStatus();
  VertexArgs args;
  args.params = state.request.vertex_shader.params;
  args.count = host.vertex_count;
  args.positions = there.positions;
  args.normals = there.normals;
  args.tangents = there.tangents;
  DevicePose pose;
  if (poses) VOXELPIPE_OK_OR_RETURN(UploadPose(state, posed, pose, args));
  if (work.places) {
    VOXELPIPE_OK_OR_RETURN(MakeRoom(state, mesh.positions, args.shaded_positions));
    if (shading && host.normals != nullptr) {
      VOXELPIPE_OK_OR_RETURN(MakeRoom(state, mesh.normals, args.shaded_normals));
    }
    if (shading && host.tangents != nullptr) {
      VOXELPIPE_OK_OR_RETURN(MakeRoom(state, mesh.tangents, args.shaded_tangents));
    }
    there.positions = args.shaded_positions;
    mesh.as_loaded = false;
    there.normals = args.shaded_normals;
    there.tangents = args.shaded_tangents;
  }
  DeviceArray<MotionRun> motions;
  if (moves) {
    VOXELPIPE_OK_OR_RETURN(MakeRoom(state, mesh.velocities, args.velocities));
    VOXELPIPE_OK_OR_RETURN(motions.Upload(state.host.motions, state.stream));
    if (!state.host.motions.empty()) args.motions = motions.data();
    args.motion_count = uint32_t(state.host.motions.size());
  }
  there.velocities = args.velocities;
  VOXELPIPE_OK_OR_RETURN(RunVertexShader(state, shader, args));
  if (!shading) {  // only the shader needed them
    mesh.normals.Free();
    mesh.tangents.Free();
  }
  return absl::OkStatus();
}

// Bytes held for the mesh: the run's device memory, and pinned memory from which it was uploaded. Call once per run.
uint64_t HeldBytes(RunState& state) {
  for (const PinnedBuffer& buffer : state.staged) state.memory.KeepOnHost(buffer.size());
  return state.memory.taken_bytes();
}

// Numbers the triangles for a request whose parts are filled.
absl::Status NumberByParts(RunState& state) {
  PartState& parts = state.parts;
  parts.filled = true;
  parts.count = uint32_t(state.request.parts->parts.size());
  const absl::StatusOr<bool> in_order = OrderRunsByParts(state.host);
  if (!in_order.ok()) return in_order.status();
  parts.ids_in_order = *in_order;
  if (*in_order) return absl::OkStatus();
  std::vector<IdRun> runs;
  for (const PartView& part : state.host.parts) {
    runs.push_back({uint32_t(part.first_triangle) + part.id_offset, part.id_offset});
  }
  std::sort(runs.begin(), runs.end(), [](const IdRun& a, const IdRun& b) { return a.first_id < b.first_id; });
  return parts.by_id.Upload(runs, state.stream);
}

// Below so many triangles the host measures faster than the device responds.
constexpr uint64_t kMinMeasured = 1 << 16;

}  // namespace

bool AnyShading(const BoundRequest& request) {
  for (const BoundShader& shader : request.fragment_shaders) {
    if (FragmentShaderId(shader.id) != FragmentShaderId::kOccupancy) return true;
  }
  return false;
}

bool WantsSums(const VoxelizeRequest& request) {
  return request.result != ResultKind::kDense || !footprint::PlainBits(request) || FillsParts(request);
}

absl::StatusOr<MeshExtent> VertexShade(RunState& state) {
  HostMesh& host = state.host;
  MakeViews(host);
  if (FillsParts(state.request.request)) VOXELPIPE_OK_OR_RETURN(NumberByParts(state));
  absl::StatusOr<PosedMesh> posed = MakePose(host);
  if (!posed.ok()) return posed.status();
  const VertexWork work = WorkOf(host, *posed);
  const bool empty = host.view.triangle_count == 0;
  if (empty || (!work.places && host.view.triangle_count < kMinMeasured)) {
    // Vertices do not change, so the box is that of the mesh itself.
    absl::StatusOr<MeshExtent> extent = MeasureMesh(host);
    if (!extent.ok()) return extent.status();
    state.box = extent->box;
    VOXELPIPE_OK_OR_RETURN(ShadeOnDevice(state, *posed, work));
    extent->held_bytes = HeldBytes(state);
    if (WantsSums(state.request.request)) {
      const Vec3d centre = (extent->box.min + extent->box.max) * 0.5;
      extent->sums = SumSurface(host.view, WindowOf(state.request.request.grid), centre);
    }
    return extent;
  }
  VOXELPIPE_OK_OR_RETURN(ShadeOnDevice(state, *posed, work));
  state.shaded_there = work.places;
  const absl::StatusOr<std::optional<MeshExtent>> extent = MeasureOnDevice(state);
  if (!extent.ok()) return extent.status();
  if (*extent) {
    MeshExtent measured = **extent;
    measured.held_bytes = HeldBytes(state);
    state.box = measured.box;
    return measured;
  }
  VOXELPIPE_OK_OR_RETURN(ShadeVertices(host));
  absl::StatusOr<MeshExtent> named = MeasureMesh(host);
  return named.ok()
             ? absl::InternalError("vertex shading: the device made a vertex that is not finite, the host did not")
             : named;
}

}  // namespace voxelpipe::cuda
