#include "load/gltf/gltf.h"

#include "load/gltf/document/gltf_buffers.h"
#include "load/gltf/document/gltf_document.h"
#include "load/gltf/document/gltf_graph.h"
#include "load/gltf/document/gltf_model.h"
#include "load/gltf/document/json_guard.h"
#include "load/gltf/geometry/gltf_accessor.h"
#include "load/gltf/geometry/gltf_meshes.h"
#include "load/gltf/gltf_animations.h"
#include "load/gltf/gltf_materials.h"
#include "load/gltf/gltf_nodes.h"

namespace voxelpipe {

// The order of the steps is the safety of the loader: guard the text, check every declaration, resolve the bytes, and
// only then read typed data, each range checked before it is read.
absl::StatusOr<Scene> LoadGltf(const JobContext& job, std::string_view json,
                               std::optional<std::span<const uint8_t>> binary_chunk, const LoadLimits& limits,
                               WarningList warnings) {
  gltf::Budget budget(job, limits, json.size() + (binary_chunk ? binary_chunk->size() : 0));
  if (absl::Status over = job.Check(); !over.ok()) return over;
  json = WithoutByteOrderMark(json, warnings);
  if (absl::Status bad = GuardJson(job, json, limits); !bad.ok()) return bad;
  if (absl::Status over = job.Check(); !over.ok()) return over;
  absl::StatusOr<gltf::Document> document = gltf::ParseDocument(job, json, limits);
  if (!document.ok()) return document.status();
  if (absl::Status over = job.Check(); !over.ok()) return over;
  MemoryCharge model_charge = budget.NewCharge();
  absl::StatusOr<tinygltf::Model> model = gltf::BuildModel(*document->graph, budget, model_charge);
  if (!model.ok()) return model.status();
  document->graph.reset();

  absl::StatusOr<gltf::Buffers> buffers = gltf::Buffers::Resolve(*document, binary_chunk, budget);
  if (!buffers.ok()) return buffers.status();
  const gltf::AccessorReader accessors(*document, *buffers, budget);

  Scene scene;
  scene.warnings = std::move(warnings);
  scene.warnings.Append(document->warnings);
  if (absl::Status bad = gltf::ReadNodes(*model, accessors, budget, scene); !bad.ok()) return bad;
  gltf::PrimitiveContext context{*document, *buffers, budget, accessors, scene.warnings};
  if (absl::Status bad = gltf::ReadMeshes(*model, context, scene); !bad.ok()) return bad;
  if (absl::Status bad = gltf::ReadMaterials(*model, *document, *buffers, budget, scene); !bad.ok()) return bad;
  // Last, so that nothing else lacks the bytes that they charge.
  if (absl::Status bad = gltf::ReadAnimations(*document, accessors, budget, scene); !bad.ok()) return bad;
  if (absl::Status bad = gltf::AddMissingNodes(*document, limits, scene); !bad.ok()) return bad;
  scene.memory = std::make_shared<MemoryCharge>(budget.Release());
  return scene;
}

}  // namespace voxelpipe
