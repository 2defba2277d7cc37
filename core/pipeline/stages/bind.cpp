#include "pipeline/stages/bind.h"

#include "absl/strings/str_cat.h"
#include "pipeline/plan/plan.h"
#include "shaders/resolve.h"

namespace voxelpipe {

absl::StatusOr<BoundRequest> BindRequest(const TriangleMesh& mesh, const VoxelizeRequest& request) {
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  BoundRequest bound;
  bound.request = request;
  bound.bodies_move = HasMotions(mesh);
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
  return bound;
}

}  // namespace voxelpipe
