#include "pipeline/stages/bind.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "mesh/parts/open_edges.h"
#include "pipeline/plan/plan.h"
#include "shaders/resolve.h"
#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

// Charges the table to bound.parts->memory. Its counts by voxel are 0.
absl::StatusOr<PartTable> TableOf(const JobContext& job, const TriangleMesh& mesh, const VoxelizeRequest& request,
                                  const PartList& list) {
  if (request.parts.scope == PartScope::kWhole || list.parts.empty()) return PartTable();
  PartShape shape{list.parts.size(), FillsParts(request), 0};
  for (const Part& part : list.parts) shape.name_bytes += part.name.size();
  if (absl::Status full = list.memory->Grow(shape.bytes(), "the table of parts"); !full.ok()) return full;
  PartTable table = MakePartTable(shape);
  if (shape.filled) {
    absl::StatusOr<std::vector<uint64_t>> open = CountOpenEdges(job, mesh, list, request.parts.scope);
    if (!open.ok()) return open.status();
    table.open_edges = *std::move(open);
  }
  for (size_t i = 0; i < list.parts.size(); ++i) {
    const Part& part = list.parts[i];
    table.label[i] = part.label;
    table.priority[i] = part.priority;
    table.triangles[i] = part.triangle_count;
    table.name_offset[i + 1] = table.name_offset[i] + part.name.size();
    std::copy(part.name.begin(), part.name.end(), table.name.begin() + ptrdiff_t(table.name_offset[i]));
  }
  return table;
}

absl::Status BindParts(const JobContext& job, const TriangleMesh& mesh, BoundRequest& bound) {
  const PartSelection& selection = bound.request.parts;
  if (selection == PartSelection()) return absl::OkStatus();
  absl::StatusOr<PartList> parts = ListParts(job, mesh, selection);
  if (!parts.ok()) return parts.status();
  if (!selection.exclude.empty() && !mesh.parts_left_out) {
    return absl::InternalError("parts are to be left out, and the mesh has them all (ExcludeParts)");
  }
  absl::StatusOr<PartTable> table = TableOf(job, mesh, bound.request, *parts);
  if (!table.ok()) return table.status();
  bound.part_table = *std::move(table);
  bound.parts = std::make_shared<const PartList>(*std::move(parts));
  return absl::OkStatus();
}

// From the smallest.
constexpr VoxelFormat kFormats[] = {VoxelFormat::kBit, VoxelFormat::kU8,  VoxelFormat::kF16,
                                    VoxelFormat::kU16, VoxelFormat::kF32, VoxelFormat::kU32};

bool HoldsExactly(VoxelFormat format, uint32_t label) {
  const uint32_t digits = label >> std::countr_zero(label);  // labels are not 0
  switch (format) {
    case VoxelFormat::kBit: return label == 1;
    case VoxelFormat::kU8: return label <= UINT8_MAX;
    case VoxelFormat::kU16: return label <= UINT16_MAX;
    case VoxelFormat::kF16: return digits < 1 << 11 && label <= 65'504;
    case VoxelFormat::kF32: return digits < 1 << 24;
    default: return true;
  }
}

// A target of labels must hold each of them exactly.
absl::Status CheckLabels(const BoundRequest& bound) {
  const auto not_held = [&](VoxelFormat format) -> std::optional<uint32_t> {
    if (bound.parts == nullptr) return std::nullopt;
    for (const Part& part : bound.parts->parts) {
      if (!HoldsExactly(format, part.label)) return part.label;
    }
    return std::nullopt;
  };
  for (size_t t = 0; t < bound.request.targets.size(); ++t) {
    const TargetSpec& target = bound.request.targets[t];
    if (FragmentShaderId(bound.fragment_shaders[t].id) != FragmentShaderId::kLabel) continue;
    const std::optional<uint32_t> label = target.blend == Blend::kCount ? std::nullopt : not_held(target.format);
    if (!label) continue;
    const VoxelFormat* const holds =
        std::find_if(std::begin(kFormats), std::end(kFormats), [&](VoxelFormat format) { return !not_held(format); });
    return absl::InvalidArgumentError(absl::StrCat("targets[", t, "].format: ", std::string(Name(target.format)),
                                                   " does not hold the label ", *label, " exactly; ",
                                                   std::string(Name(*holds)), " holds all of them"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<BoundRequest> BindRequest(const JobContext& job, const TriangleMesh& mesh,
                                         const VoxelizeRequest& request) {
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  BoundRequest bound;
  bound.request = request;
  bound.bodies_move = HasMotions(mesh);
  if (absl::Status s = BindParts(job, mesh, bound); !s.ok()) return s;
  auto vertex = BindShader(ShaderStage::kVertex, request.vertex_shader);
  if (!vertex.ok()) return vertex.status();
  bound.vertex_shader = *vertex;
  for (const TargetSpec& target : request.targets) {
    auto fragment = BindShader(ShaderStage::kFragment, target.shader);
    if (!fragment.ok()) return fragment.status();
    if (absl::Status s = ResolveShader(mesh, *fragment); !s.ok()) {
      const size_t index = bound.fragment_shaders.size();
      return absl::Status(s.code(), absl::StrCat("targets[", index, "].shader: ", std::string(s.message())));
    }
    bound.fragment_shaders.push_back(*fragment);
  }
  if (absl::Status s = CheckLabels(bound); !s.ok()) return s;
  return bound;
}

}  // namespace voxelpipe
