#include "load/loader.h"

#include <algorithm>
#include <new>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "load/decode/draco.h"
#include "load/decode/glb_container.h"
#include "load/gltf/gltf.h"
#include "load/load_job.h"
#include "load/obj/obj.h"
#include "load/off/off.h"
#include "load/ply/ply.h"
#include "load/stl/stl.h"
#include "load/threemf/threemf.h"

namespace voxelpipe {
namespace {

absl::StatusOr<Scene> Named(const char* format, absl::StatusOr<Scene> scene) {
  if (scene.ok()) scene->format = format;
  return scene;
}

absl::StatusOr<Scene> Dispatch(const JobContext& job, std::span<const uint8_t> bytes, MeshFormat format,
                               const LoadLimits& limits) {
  switch (format) {
    case MeshFormat::kGlb: {
      absl::StatusOr<GlbChunks> chunks = SplitGlb(job, bytes);
      if (!chunks.ok()) return chunks.status();
      WarningList warnings;
      AddLeftOverBytes(*chunks, warnings);
      return Named("glb", LoadGltf(job, chunks->json, chunks->binary, limits, std::move(warnings)));
    }
    case MeshFormat::kGltf: {
      const std::string_view json(reinterpret_cast<const char*>(bytes.data()), bytes.size());
      return Named("gltf", LoadGltf(job, json, std::nullopt, limits, {}));
    }
    case MeshFormat::kDraco: return Named("drc", LoadDraco(job, bytes, limits));
    case MeshFormat::kStl: return Named("stl", LoadStl(job, bytes, limits));
    case MeshFormat::kPly: return Named("ply", LoadPly(job, bytes, limits));
    case MeshFormat::kOff: return Named("off", LoadOff(job, bytes, limits));
    case MeshFormat::kObj: return Named("obj", LoadObj(job, bytes, limits));
    case MeshFormat::k3mf: return Named("3mf", Load3mf(job, bytes, limits));
    case MeshFormat::kAuto: break;
  }
  return absl::InternalError("the mesh format was not resolved");
}

// Scales a scene of a format without a unit to metres, by its nodes: in double.
absl::Status SetUnit(LengthUnit unit, Scene& scene) {
  const bool has_own = scene.format == "glb" || scene.format == "gltf" || scene.format == "3mf";
  if (scene.format == "glb" || scene.format == "gltf") scene.unit = "m";
  if (unit == LengthUnit::kNone) return absl::OkStatus();
  if (has_own) {
    return absl::InvalidArgumentError(absl::StrCat("mesh_unit: the file has a unit of its own (", scene.unit,
                                                   "); one is given only for STL, PLY, OFF, OBJ and Draco"));
  }
  scene.unit = std::string(Name(unit));
  const double metres = MetresOf(unit);
  for (const uint32_t root : scene.roots) {
    Node& node = scene.nodes[root];
    node.trs.scale = {metres, metres, metres};  // the loaders of these formats leave the root without a transform
    node.local = FromTrs(node.trs);
  }
  return absl::OkStatus();
}

// Formats that are not read, by what their files begin with, or have behind that.
struct OtherFormat {
  std::string_view beginning, further, name;
};
constexpr OtherFormat kOthers[] = {
    {"Kaydara FBX Binary", "", "FBX"}, {"; FBX", "", "FBX"},        {"ISO-10303-21", "", "STEP"},
    {"PXR-USDC", "", "USD"},           {"#usda", "", "USD"},        {"PK\3\4", ".usd", "USDZ"},
    {"PK\3\4", "", "a ZIP archive"},   {"\x1f\x8b", "", "gzip"},    {"\x28\xb5\x2f\xfd", "", "zstd"},
    {"BLENDER", "", "Blender"},        {"#VRML", "", "VRML"},       {"# vtk DataFile", "", "VTK"},
    {"<VTKFile", "", "VTK"},           {"$MeshFormat", "", "Gmsh"}, {"<?xml", "<COLLADA", "COLLADA"},
    {"<?xml", "<X3D", "X3D"},          {"<?xml", "<VTKFile", "VTK"}};

// The error of a mesh of no format that is read; says which one it is, if it is known.
absl::Status NotReadable(std::span<const uint8_t> bytes) {
  constexpr size_t kBytes = 4096;
  constexpr std::string_view kRead = "GLB, glTF 2.0, Draco, STL, PLY, OFF, OBJ and 3MF are read";
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), std::min(bytes.size(), kBytes));
  for (const OtherFormat& other : kOthers) {
    if (!text.starts_with(other.beginning) || text.find(other.further) == std::string_view::npos) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("the mesh is ", std::string(other.name), ", which is not read; ", std::string(kRead)));
  }
  return absl::InvalidArgumentError(
      absl::StrCat("the mesh is of no known format; ", std::string(kRead),
                   "; if the content does not show its format, give it (--input-format, mesh_format)"));
}

}  // namespace

absl::StatusOr<Scene> LoadScene(std::span<const uint8_t> bytes, MeshFileType type, const LoadLimits& limits) {
  const JobContext endless;
  return LoadSceneFor(endless, bytes, type, limits);
}

absl::StatusOr<Scene> LoadSceneFor(const JobContext& job, std::span<const uint8_t> bytes, MeshFileType type,
                                   const LoadLimits& limits) {
  if (bytes.empty()) return absl::InvalidArgumentError("the mesh is empty (zero bytes)");
  if (bytes.size() > limits.max_file_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the mesh has ", bytes.size(), " bytes; the limit max_file_bytes is ", limits.max_file_bytes));
  }
  if (type.format == MeshFormat::kAuto) {
    const absl::StatusOr<MeshFormat> detected = DetectMeshFormat(job, bytes);
    if (!detected.ok()) return detected.status();
    if (*detected == MeshFormat::kAuto) {
      return NotReadable(bytes);
    }
    type.format = *detected;
  }
  try {
    absl::StatusOr<Scene> scene = Dispatch(job, bytes, type.format, limits);
    if (scene.ok()) {
      if (absl::Status bad = SetUnit(type.unit, *scene); !bad.ok()) return bad;
    }
    // The end of the job may have become an error that names an accessor, a warning or an animation's fault.
    if (absl::Status over = job.Check(); !over.ok()) return over;
    return scene;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("not enough memory to load the mesh");
  }
}

}  // namespace voxelpipe
