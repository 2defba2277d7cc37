#include "pipeline/warnings.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "grid/grid_spec.h"
#include "mesh/report.h"
#include "mesh/texture_faults.h"
#include "pipeline/stages/target_rules.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

// True if no target keeps a fragment of a masked material whose alpha is too small.
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

bool GivesFractions(const ShaderCall& shader) {
  const ShaderInfo* const info = FindShader(ShaderStage::kFragment, shader.name);
  if (info == nullptr) return false;
  const auto value = shader.parameters.find("value");
  if (shader.name != "constant" || value == shader.parameters.end()) return info->is_fraction;
  const std::vector<double>& numbers = value->second;
  return std::any_of(numbers.begin(), numbers.end(), [](double number) { return number != std::floor(number); });
}

// True if whole numbers are all that is left of the shader's values.
bool RoundsFractions(const TargetSpec& target) {
  const bool integer = target.format == VoxelFormat::kU8 || target.format == VoxelFormat::kU16;
  return integer && !target.scale && target.encoding == Encoding::kLinear && target.blend != Blend::kCount &&
         GivesFractions(target.shader);
}

void AddTargetWarnings(const VoxelizeRequest& request, bool bodies_move, WarningList& warnings) {
  for (size_t t = 0; t < request.targets.size(); ++t) {
    const TargetSpec& target = request.targets[t];
    const std::string place = absl::StrCat("targets[", t, "]");
    if (request.fill != Fill::kNone && !HasFillValue(request, target, bodies_move)) {
      warnings.Add(WarningCode::kFillHasNoValue, place,
                   absl::StrCat("'", target.shader.name, "' has no value without a triangle: filled voxels hold ",
                                target.clear, "; the target's fill=... gives them another"));
    }
    if (RoundsFractions(target)) {
      warnings.Add(WarningCode::kValuesRounded, place,
                   absl::StrCat("'", target.shader.name, "' gives fractions, which ", std::string(Name(target.format)),
                                " rounds to whole numbers; the target's scale=..., ",
                                TakesSnorm(target.shader.name) ? "encoding=snorm, " : "", "or f16 or f32, keeps them"));
    }
  }
}

Box3d BoxOf(const GridRequest& grid) {
  Box3d box{*grid.origin, *grid.origin, false};
  for (int a = 0; a < 3; ++a) {
    const double h = (*grid.voxel_size)[a];
    box.min[a] -= double(grid.padding) * h;
    box.max[a] += double((*grid.dims)[size_t(a)] + grid.padding) * h;
  }
  return box;
}

std::string Shown(const Box3d& box) {
  const auto corner = [](const Vec3d& p) {
    return absl::StrCat("(", ExactText(p.x), ", ", ExactText(p.y), ", ", ExactText(p.z), ")");
  };
  return absl::StrCat(corner(box.min), " to ", corner(box.max));
}

// Of an empty result on a grid that was given.
void WarnIfOutside(const JobContext& job, const TriangleMesh& mesh, const VoxelizeRequest& request,
                   VoxelizeStats& stats) {
  // A triangle in the grid may cover no voxel of it, unless voxels that it touches are covered.
  if (request.coverage != Coverage::kConservative && stats.triangles_outside < stats.triangles) return;
  const absl::StatusOr<MeshReport> report = BoxReport(job, mesh);
  if (!report.ok()) return;  // the job ended, which its next stage says
  const Box3d of_grid = BoxOf(request.grid), of_mesh{report->min, report->max, false};
  const bool moved = request.vertex_shader.name != "identity";
  stats.warnings.Add(WarningCode::kOutsideGrid, "",
                     absl::StrCat("no triangle reaches the grid, ", Shown(of_grid), "; the mesh lies at ",
                                  Shown(of_mesh), moved ? " before its vertex shader" : ""));
}

}  // namespace

WarningList WarningsOf(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  WarningList warnings = mesh.warnings;
  AddTextureWarnings(mesh, TexturesRead(request), warnings);
  if (!mesh.triangles.empty()) AddTargetWarnings(request, HasMotions(mesh), warnings);
  return warnings;
}

WarningList WarningsOf(const TriangleMesh& mesh, const BoundRequest& request) {
  WarningList warnings = WarningsOf(mesh, request.request);
  if (request.parts != nullptr) warnings.Append(request.parts->warnings);
  const PartTable& parts = request.part_table;
  for (size_t i = 0; i < parts.open_edges.size(); ++i) {
    if (parts.open_edges[i] == 0) continue;
    const std::string called = parts.Name(i).empty() ? "" : absl::StrCat(" '", std::string(parts.Name(i)), "'");
    warnings.Add(WarningCode::kPartOpen, absl::StrCat("parts[", i, "]"),
                 absl::StrCat("the part", called, " has ", parts.open_edges[i],
                              " open edges: it bounds no solid, and its inside may be filled in part or not at all"));
  }
  return warnings;
}

WarningList AllWarningsOf(const TriangleMesh& mesh) {
  WarningList warnings = mesh.warnings;
  AddAllTextureWarnings(mesh, warnings);
  return warnings;
}

void AddRunWarnings(const JobContext& job, const TriangleMesh& mesh, const VoxelizeRequest& request,
                    VoxelizeStats& stats) {
  if (stats.occupied > 0 || mesh.triangles.empty()) return;
  const bool given = request.grid.given();
  const bool discards = request.coverage != Coverage::kNone && EveryShaderDiscards(request) && HasMask(mesh);
  // A grid that was given may lie beside the mesh. Fragments that are counted before shaders see them tell; those of
  // buckets are counted after, so there the text leaves it open.
  if (!discards || (given && request.result != ResultKind::kBuckets && stats.fragments == uint64_t{0})) {
    if (given) WarnIfOutside(job, mesh, request, stats);
    return;
  }
  stats.warnings.Add(WarningCode::kAllDiscarded, "",
                     given ? "the result is empty: alpha masks discarded every fragment that lies in the grid"
                           : "the result is empty: alpha masks discarded every fragment");
}

absl::Status CheckStrict(const VoxelizeRequest& request, const WarningList& warnings) {
  if (!request.strict || warnings.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(warnings.kept().front().Line());
}

}  // namespace voxelpipe
