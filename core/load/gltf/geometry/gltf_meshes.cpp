#include "load/gltf/geometry/gltf_meshes.h"

#include <algorithm>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "load/gltf/document/gltf_model.h"
#include "load/gltf/document/gltf_sanitize.h"

namespace voxelpipe::gltf {
namespace {

constexpr size_t kPrimitivesAStep = 1024;     // between two polls of the job
constexpr size_t kAttributesAStep = 1 << 12;  // the same
constexpr size_t kVerticesAStep = 1 << 16;    // the same

absl::StatusOr<Mesh> ReadMesh(const tinygltf::Mesh& mesh, const std::vector<double>& weights, size_t index,
                              PrimitiveContext& context) {
  Mesh out;
  out.name = mesh.name;
  const std::string where = absl::StrCat("mesh ", index);
  Budget& budget = context.budget;
  if (absl::Status full = budget.Take(weights.size(), sizeof(double), where); !full.ok()) return full;
  if (absl::Status full = budget.Take(mesh.primitives.size(), sizeof(Primitive), where); !full.ok()) return full;
  out.weights = weights;
  out.primitives.reserve(mesh.primitives.size());
  for (size_t i = 0; i < mesh.primitives.size(); ++i) {
    if (i % kPrimitivesAStep == 0) {
      if (absl::Status over = budget.job().Check(); !over.ok()) return over;
    }
    absl::StatusOr<std::optional<Primitive>> primitive =
        ReadPrimitive(mesh.primitives[i], weights, absl::StrCat(where, ", primitive ", i), context);
    if (!primitive.ok()) return primitive.status();
    // A primitive without triangles is kept, so that primitives are numbered as in the file.
    out.primitives.push_back(*primitive ? **std::move(primitive) : Primitive{});
  }
  const auto others = std::count_if(out.primitives.begin(), out.primitives.end(),
                                    [](const Primitive& primitive) { return primitive.points_or_lines; });
  if (others > 0) {
    context.warnings.Add(
        WarningCode::kNoTriangles, where,
        absl::StrCat(others, " of ", out.primitives.size(), " primitives are points or lines and have no triangles"));
  }
  return out;
}

bool HasTargets(const tinygltf::Mesh& mesh) {
  return std::any_of(mesh.primitives.begin(), mesh.primitives.end(),
                     [](const tinygltf::Primitive& primitive) { return !primitive.targets.empty(); });
}

// The largest joint index that has a weight, -1 if there is none.
absl::StatusOr<int> LargestJoint(const JobContext& job, const Mesh& mesh) {
  int largest = -1;
  for (const Primitive& primitive : mesh.primitives) {
    for (int set = 0; set < 2; ++set) {
      for (size_t i = 0; i < primitive.joints[set].size(); ++i) {
        if (i % kVerticesAStep == 0) {
          if (absl::Status over = job.Check(); !over.ok()) return over;
        }
        for (int c = 0; c < 4; ++c) {
          if (primitive.weights[set][i][c] != 0) largest = std::max<int>(largest, primitive.joints[set][i][c]);
        }
      }
    }
  }
  return largest;
}

absl::Status CheckJoints(const JobContext& job, const Scene& scene) {
  std::vector<int> largest;
  for (const Mesh& mesh : scene.meshes) {
    const absl::StatusOr<int> joint = LargestJoint(job, mesh);
    if (!joint.ok()) return joint.status();
    largest.push_back(*joint);
  }
  for (size_t i = 0; i < scene.nodes.size(); ++i) {
    const Node& node = scene.nodes[i];
    if (node.mesh < 0 || node.skin < 0) continue;
    const size_t joints = scene.skins[node.skin].joints.size();
    if (largest[node.mesh] >= static_cast<int64_t>(joints)) {
      return absl::InvalidArgumentError(absl::StrCat("glTF: node ", i, ": mesh ", node.mesh, " uses joint ",
                                                     largest[node.mesh], ", skin ", node.skin, " has ", joints,
                                                     " joints"));
    }
  }
  return absl::OkStatus();
}

// Warns if primitives lack an application-specific attribute or differ in its components.
absl::Status WarnOfUnevenAttributes(const JobContext& job, const std::vector<Mesh>& meshes, WarningList& warnings) {
  struct Use {
    size_t primitives = 0;
    int least = 4, most = 1;  // components
  };
  std::map<std::string, Use> uses;
  size_t drawn = 0, read = 0;
  for (const Mesh& mesh : meshes) {
    for (const Primitive& primitive : mesh.primitives) {
      if (!primitive.triangles.empty()) ++drawn;
      for (const VertexAttribute& attribute : primitive.attributes) {
        if (read++ % kAttributesAStep == 0) {
          if (absl::Status over = job.Check(); !over.ok()) return over;
        }
        Use& use = uses[attribute.name];
        if (!primitive.triangles.empty()) ++use.primitives;
        use.least = std::min(use.least, attribute.components);
        use.most = std::max(use.most, attribute.components);
      }
    }
  }
  for (const auto& [name, use] : uses) {
    if (use.primitives < drawn) {
      warnings.Add(
          WarningCode::kCountMismatch, absl::StrCat("attribute ", name),
          absl::StrCat("is missing in ", drawn - use.primitives, " of ", drawn, " primitives; it counts as 0 there"));
    }
    if (use.least < use.most) {
      warnings.Add(WarningCode::kCountMismatch, absl::StrCat("attribute ", name),
                   absl::StrCat("has ", use.least, " to ", use.most, " components; it counts as ", use.most));
    }
  }
  return absl::OkStatus();
}

// The Draco streams of the meshes in reading order, up to the first that is faulty (reading it reports that) or that
// must itself be decompressed first (which charges the budget in its turn).
std::vector<std::span<const uint8_t>> DracoStreams(const tinygltf::Model& model, PrimitiveContext& context) {
  std::vector<std::span<const uint8_t>> streams;
  for (const tinygltf::Mesh& mesh : model.meshes) {
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const auto extension = primitive.extensions.find("KHR_draco_mesh_compression");
      if (extension == primitive.extensions.end()) continue;
      const auto view = static_cast<size_t>(extension->second.Get("bufferView").GetNumberAsInt());
      if (view < context.document.views.size() && context.document.views[view].meshopt) return streams;
      const absl::StatusOr<std::optional<std::span<const uint8_t>>> bytes = DracoStream(primitive, "", context);
      if (!bytes.ok()) return streams;
      if (*bytes) streams.push_back(**bytes);
    }
  }
  return streams;
}

}  // namespace

absl::Status ReadMeshes(const tinygltf::Model& model, PrimitiveContext& context, Scene& scene) {
  DracoAhead draco(context.budget.job(), DracoStreams(model, context), context.budget.limits());
  context.draco = &draco;
  for (size_t i = 0; i < model.meshes.size(); ++i) {
    absl::StatusOr<Mesh> mesh = ReadMesh(model.meshes[i], model.meshes[i].weights, i, context);
    if (!mesh.ok()) return mesh.status();
    scene.meshes.push_back(*std::move(mesh));
  }
  if (absl::Status over = WarnOfUnevenAttributes(context.budget.job(), scene.meshes, scene.warnings); !over.ok()) {
    return over;
  }
  std::vector<bool> has_targets;
  uint64_t primitives = 0;
  for (const tinygltf::Mesh& mesh : model.meshes) {
    has_targets.push_back(HasTargets(mesh));
    primitives += mesh.primitives.size();
  }
  std::map<std::pair<int, std::vector<double>>, int> copies;
  for (size_t i = 0; i < scene.nodes.size(); ++i) {
    if (i % kPrimitivesAStep == 0) {
      if (absl::Status over = context.budget.job().Check(); !over.ok()) return over;
    }
    const std::vector<double>& weights = model.nodes[i].weights;
    const int index = scene.nodes[i].mesh;
    if (index < 0 || weights.empty() || !has_targets[size_t(index)] || weights == model.meshes[index].weights) continue;
    const auto [place, fresh] = copies.try_emplace({index, weights}, static_cast<int>(scene.meshes.size()));
    if (fresh) {
      primitives += model.meshes[index].primitives.size();
      if (primitives > kMaxElements) {
        return absl::ResourceExhaustedError(absl::StrCat(
            "glTF: node ", i, ": meshes with weights of their nodes make more than ", kMaxElements, " primitives"));
      }
      absl::StatusOr<Mesh> mesh = ReadMesh(model.meshes[index], weights, static_cast<size_t>(index), context);
      if (!mesh.ok()) return mesh.status();
      scene.meshes.push_back(*std::move(mesh));
    }
    scene.nodes[i].mesh = place->second;
  }
  context.draco = nullptr;
  return CheckJoints(context.budget.job(), scene);
}

}  // namespace voxelpipe::gltf
