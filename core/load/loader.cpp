#include "load/loader.h"

#include <new>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "load/decode/draco.h"
#include "load/decode/glb_container.h"
#include "load/gltf/gltf.h"
#include "load/load_job.h"

namespace voxelpipe {
namespace {

absl::StatusOr<Scene> Dispatch(const JobContext& job, std::span<const uint8_t> bytes, MeshFormat format,
                               const LoadLimits& limits) {
  switch (format) {
    case MeshFormat::kGlb: {
      absl::StatusOr<GlbChunks> chunks = SplitGlb(bytes);
      if (!chunks.ok()) return chunks.status();
      WarningList warnings;
      AddLeftOverBytes(*chunks, warnings);
      absl::StatusOr<Scene> scene = LoadGltf(job, chunks->json, chunks->binary, limits, std::move(warnings));
      if (scene.ok()) scene->format = "glb";
      return scene;
    }
    case MeshFormat::kGltf: {
      const std::string_view json(reinterpret_cast<const char*>(bytes.data()), bytes.size());
      absl::StatusOr<Scene> scene = LoadGltf(job, json, std::nullopt, limits, {});
      if (scene.ok()) scene->format = "gltf";
      return scene;
    }
    case MeshFormat::kDraco: {
      absl::StatusOr<Scene> scene = LoadDraco(job, bytes, limits);
      if (scene.ok()) scene->format = "drc";
      return scene;
    }
    case MeshFormat::kAuto: break;
  }
  return absl::InternalError("the mesh format was not resolved");
}

}  // namespace

absl::StatusOr<Scene> LoadScene(std::span<const uint8_t> bytes, MeshFormat format, const LoadLimits& limits) {
  const JobContext endless;
  return LoadSceneFor(endless, bytes, format, limits);
}

absl::StatusOr<Scene> LoadSceneFor(const JobContext& job, std::span<const uint8_t> bytes, MeshFormat format,
                                   const LoadLimits& limits) {
  if (bytes.empty()) return absl::InvalidArgumentError("the mesh is empty (zero bytes)");
  if (bytes.size() > limits.max_file_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the mesh has ", bytes.size(), " bytes; the limit max_file_bytes is ", limits.max_file_bytes));
  }
  if (format == MeshFormat::kAuto) {
    const std::optional<MeshFormat> sniffed = SniffMeshFormat(bytes);
    if (!sniffed) {
      return absl::InvalidArgumentError(
          "the first bytes are of no format that can be read (GLB, glTF 2.0 JSON, Draco); a compressed archive must be "
          "unpacked first");
    }
    format = *sniffed;
  }
  try {
    absl::StatusOr<Scene> scene = Dispatch(job, bytes, format, limits);
    // The end of the job may have become an error that names an accessor, a warning or an animation's fault.
    if (absl::Status over = job.Check(); !over.ok()) return over;
    return scene;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("not enough memory to load the mesh");
  }
}

}  // namespace voxelpipe
