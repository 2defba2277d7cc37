#include "pipeline/warnings.h"

#include <algorithm>
#include <string>

#include "mesh/texture_faults.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

// Whether no target keeps a fragment of a masked material whose alpha is too small.
bool EveryShaderDiscards(const VoxelizeRequest& request) {
  return std::all_of(request.targets.begin(), request.targets.end(), [](const TargetSpec& target) {
    const ShaderInfo* const info = FindShader(ShaderStage::kFragment, target.shader.name);
    return info != nullptr && info->can_discard;
  });
}

bool HasMask(const TriangleMesh& mesh) {
  const std::vector<bool> used = MaterialsInUse(mesh);
  for (size_t i = 0; i < used.size(); ++i) {
    if (used[i] && mesh.materials[i].alpha_mode == AlphaMode::kMask) return true;
  }
  return false;
}

}  // namespace

WarningList WarningsOf(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  WarningList warnings = mesh.warnings;
  AddTextureWarnings(mesh, TexturesRead(request), warnings);
  return warnings;
}

WarningList AllWarningsOf(const TriangleMesh& mesh) {
  WarningList warnings = mesh.warnings;
  AddAllTextureWarnings(mesh, warnings);
  return warnings;
}

void AddRunWarnings(const TriangleMesh& mesh, const VoxelizeRequest& request, VoxelizeStats& stats) {
  if (request.coverage == Coverage::kNone) return;  // there are no fragments to discard
  if (stats.occupied > 0 || mesh.triangles.empty() || !EveryShaderDiscards(request) || !HasMask(mesh)) return;
  // A grid that was given may lie beside the mesh. Fragments that are counted before shaders see them tell; those of
  // buckets are counted after, so there the text leaves it open.
  const bool given = request.grid.dims.has_value();
  if (given && request.result != ResultKind::kBuckets && stats.fragments == uint64_t{0}) return;
  stats.warnings.Add(WarningCode::kAllDiscarded, "",
                     given ? "the result is empty: alpha masks discarded every fragment that lies in the grid"
                           : "the result is empty: alpha masks discarded every fragment");
}

absl::Status CheckStrict(const VoxelizeRequest& request, const WarningList& warnings) {
  if (!request.strict || warnings.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(warnings.kept().front().Line());
}

}  // namespace voxelpipe
