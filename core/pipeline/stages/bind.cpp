#include "pipeline/stages/bind.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "pipeline/plan/plan.h"
#include "shaders/resolve.h"
#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

absl::Status BindParts(const JobContext& job, const TriangleMesh& mesh, BoundRequest& bound) {
  const PartSelection& selection = bound.request.parts;
  if (selection == PartSelection()) return absl::OkStatus();
  absl::StatusOr<PartList> parts = ListParts(job, mesh, selection);
  if (!parts.ok()) return parts.status();
  if (!selection.exclude.empty() && !mesh.parts_left_out) {
    return absl::InternalError("parts are to be left out, and the mesh has them all (ExcludeParts)");
  }
  bound.parts = std::make_shared<const PartList>(*std::move(parts));
  return absl::OkStatus();
}

// The largest label that each format holds, with all below.
constexpr std::pair<VoxelFormat, uint64_t> kLargestLabels[] = {
    {VoxelFormat::kBit, 1},          {VoxelFormat::kU8, 255},      {VoxelFormat::kF16, 1 << 11},
    {VoxelFormat::kU16, UINT16_MAX}, {VoxelFormat::kF32, 1 << 24}, {VoxelFormat::kU32, UINT32_MAX}};

// A target of labels must hold each of them exactly.
absl::Status CheckLabels(const BoundRequest& bound) {
  uint32_t largest = 1;
  if (bound.parts != nullptr) {
    for (const Part& part : bound.parts->parts) largest = std::max(largest, part.label);
  }
  for (size_t t = 0; t < bound.request.targets.size(); ++t) {
    const TargetSpec& target = bound.request.targets[t];
    if (FragmentShaderId(bound.fragment_shaders[t].id) != FragmentShaderId::kLabel) continue;
    if (target.blend == Blend::kCount) continue;
    std::string_view holds = Name(VoxelFormat::kU32);
    for (const auto& [format, most] : kLargestLabels) {
      if (format == target.format && largest <= most) holds = "";
    }
    if (holds.empty()) continue;
    for (const auto& [format, most] : kLargestLabels) {
      if (largest > most) continue;
      holds = Name(format);
      break;
    }
    return absl::InvalidArgumentError(absl::StrCat("targets[", t, "].format: ", std::string(Name(target.format)),
                                                   " does not hold the label ", largest, " exactly; ",
                                                   std::string(holds), " does"));
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
