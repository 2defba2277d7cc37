#include "shaders/resolve.h"

#include <algorithm>
#include <span>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "shaders/shader_list.h"

namespace voxelpipe {

absl::Status ResolveShader(const TriangleMesh& mesh, BoundShader& shader) {
  if (shader.info->stage != ShaderStage::kFragment) return absl::OkStatus();
  if (FragmentShaderId(shader.id) != FragmentShaderId::kAttribute) return absl::OkStatus();
  const std::string& name = shader.text.at("name");
  const auto found = std::find_if(mesh.attributes.begin(), mesh.attributes.end(),
                                  [&](const VertexAttribute& attribute) { return attribute.name == name; });
  if (found == mesh.attributes.end()) {
    constexpr size_t kMaxNames = 50;
    const std::span<const VertexAttribute> shown(mesh.attributes.data(), std::min(kMaxNames, mesh.attributes.size()));
    std::string known =
        absl::StrJoin(shown, ", ", [](std::string* out, const VertexAttribute& a) { out->append(a.name); });
    if (shown.size() < mesh.attributes.size()) known += ", ...";
    return absl::InvalidArgumentError(absl::StrCat("shader 'attribute': the mesh has no attribute '", name,
                                                   "' (it has ", known.empty() ? "none of its own" : known, ")"));
  }
  shader.params.value[0] = double(found - mesh.attributes.begin() + 1);
  return absl::OkStatus();
}

}  // namespace voxelpipe
