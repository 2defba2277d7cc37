#include "load/gltf/gltf_nodes.h"

#include <cmath>
#include <optional>

#include "absl/strings/str_cat.h"
#include "load/gltf/document/gltf_model.h"

namespace voxelpipe::gltf {
namespace {

constexpr size_t kNodesAStep = 4096;  // nodes or instances between two polls of the job

template <typename... Parts>
absl::Status Broken(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat("glTF: ", parts...));
}

Vec3d ToVec3(const std::vector<double>& values, double fallback) {
  if (values.size() != 3) return {fallback, fallback, fallback};
  return {values[0], values[1], values[2]};
}

Trs ReadTrs(const tinygltf::Node& node) {
  Trs trs{ToVec3(node.translation, 0), {0, 0, 0, 1}, ToVec3(node.scale, 1)};
  for (size_t i = 0; i < node.rotation.size() && i < 4; ++i) trs.rotation[i] = node.rotation[i];
  return trs;
}

Mat4d LocalTransform(const tinygltf::Node& node) {
  if (node.matrix.size() == 16) {
    Mat4d out;  // column-major in the file
    for (int column = 0; column < 4; ++column) {
      for (int row = 0; row < 4; ++row) out.m[row][column] = node.matrix[column * 4 + row];
    }
    return out;
  }
  return FromTrs(ReadTrs(node));
}

bool IsFinite(const Mat4d& matrix) {
  for (const auto& row : matrix.m) {
    for (const double value : row) {
      if (!std::isfinite(value)) return false;
    }
  }
  return true;
}

// Values of one attribute of EXT_mesh_gpu_instancing; empty if the extension does not have it.
absl::StatusOr<std::vector<float>> InstanceValues(const tinygltf::Value& attributes, const char* name, int components,
                                                  const AccessorReader& accessors, const std::string& where,
                                                  std::optional<uint64_t>& count) {
  if (!attributes.Has(name)) return std::vector<float>();
  const uint32_t accessor = static_cast<uint32_t>(attributes.Get(name).GetNumberAsInt());
  const AccessorDecl& decl = accessors.decl(accessor);
  if (decl.components != components || decl.matrix) {
    return Broken(where, ": ", name, " (accessor ", accessor, ") has ", decl.components, " components, not ",
                  components);
  }
  if (count && *count != decl.count) {
    return Broken(where, ": ", name, " (accessor ", accessor, ") has ", decl.count, " elements, not ", *count);
  }
  count = decl.count;
  return accessors.Floats(accessor);
}

absl::Status ReadInstances(const tinygltf::Node& node, const AccessorReader& accessors, Budget& budget,
                           const std::string& where, uint64_t& total, Node& out) {
  const LoadLimits& limits = budget.limits();
  const auto extension = node.extensions.find("EXT_mesh_gpu_instancing");
  if (extension == node.extensions.end()) return absl::OkStatus();
  const tinygltf::Value& attributes = extension->second.Get("attributes");
  std::optional<uint64_t> count;
  const uint64_t before = budget.bytes();
  absl::StatusOr<std::vector<float>> t = InstanceValues(attributes, "TRANSLATION", 3, accessors, where, count);
  if (!t.ok()) return t.status();
  absl::StatusOr<std::vector<float>> r = InstanceValues(attributes, "ROTATION", 4, accessors, where, count);
  if (!r.ok()) return r.status();
  absl::StatusOr<std::vector<float>> s = InstanceValues(attributes, "SCALE", 3, accessors, where, count);
  if (!s.ok()) return s.status();
  if (!count) return absl::OkStatus();
  total += *count;
  if (total > limits.max_instances) {
    return absl::ResourceExhaustedError(
        absl::StrCat("glTF: ", where, ": ", total, " instances; the limit max_instances is ", limits.max_instances));
  }
  if (absl::Status full = budget.Take(*count, sizeof(Mat4d), where + ", instances"); !full.ok()) return full;
  out.instances.reserve(*count);
  for (uint64_t i = 0; i < *count; ++i) {
    if (i % kNodesAStep == 0) {
      if (absl::Status over = budget.job().Check(); !over.ok()) return over;
    }
    Trs trs;
    if (!t->empty()) trs.translation = {(*t)[3 * i], (*t)[3 * i + 1], (*t)[3 * i + 2]};
    if (!s->empty()) trs.scale = {(*s)[3 * i], (*s)[3 * i + 1], (*s)[3 * i + 2]};
    for (int c = 0; c < 4 && !r->empty(); ++c) trs.rotation[c] = (*r)[4 * i + c];
    out.instances.push_back(FromTrs(trs));
    if (!IsFinite(out.instances.back())) return Broken(where, ": instance ", i, " is not finite");
  }
  budget.ShrinkTo(before + *count * sizeof(Mat4d));  // the values of the accessors are freed
  // No instances draw nothing; an empty list would mean one instance.
  if (out.instances.empty()) out.mesh = -1;
  return absl::OkStatus();
}

// Proves the forest, level by level from the roots, and applies KHR_node_visibility.
absl::Status CheckHierarchy(const tinygltf::Model& model, const LoadLimits& limits, Scene& scene) {
  const size_t count = scene.nodes.size();
  std::vector<int64_t> parent(count, -1);
  for (size_t i = 0; i < count; ++i) {
    for (const uint32_t child : scene.nodes[i].children) {
      if (parent[child] >= 0)
        return Broken("node ", child, " is a child of both node ", parent[child], " and node ", i);
      parent[child] = static_cast<int64_t>(i);
    }
  }
  std::vector<uint32_t> level, next;
  for (size_t i = 0; i < count; ++i) {
    if (parent[i] < 0) level.push_back(static_cast<uint32_t>(i));
  }
  std::vector<bool> reached(count), hidden(count);
  for (uint32_t depth = 1; !level.empty(); ++depth) {
    if (depth > limits.max_node_depth) {
      return absl::ResourceExhaustedError(
          absl::StrCat("glTF: node ", level[0], " lies deeper than the limit max_node_depth, ", limits.max_node_depth));
    }
    next.clear();
    for (const uint32_t i : level) {
      reached[i] = true;
      const auto visibility = model.nodes[i].extensions.find("KHR_node_visibility");
      if (visibility != model.nodes[i].extensions.end()) {
        const tinygltf::Value& visible = visibility->second.Get("visible");
        if (visible.IsBool() && !visible.Get<bool>()) hidden[i] = true;
      }
      if (parent[i] >= 0 && hidden[parent[i]]) hidden[i] = true;
      if (hidden[i]) scene.nodes[i].mesh = -1;
      next.insert(next.end(), scene.nodes[i].children.begin(), scene.nodes[i].children.end());
    }
    level.swap(next);
  }
  for (size_t i = 0; i < count; ++i) {
    if (!reached[i]) return Broken("node ", i, " is part of a cycle of children");
  }
  return absl::OkStatus();
}

absl::Status ReadSkins(const tinygltf::Model& model, const AccessorReader& accessors, Budget& budget, Scene& scene) {
  for (size_t i = 0; i < model.skins.size(); ++i) {
    const tinygltf::Skin& skin = model.skins[i];
    const uint64_t before = budget.bytes(),
                   bytes = sizeof(Skin) + skin.joints.size() * (sizeof(uint32_t) + sizeof(Mat4d));
    if (absl::Status full = budget.Take(bytes, 1, absl::StrCat("skin ", i)); !full.ok()) return full;
    Skin out;
    out.joints.assign(skin.joints.begin(), skin.joints.end());
    out.inverse_bind_matrices.resize(out.joints.size());
    if (skin.inverseBindMatrices >= 0) {
      const uint32_t accessor = static_cast<uint32_t>(skin.inverseBindMatrices);
      const AccessorDecl& decl = accessors.decl(accessor);
      if (decl.components != 16)
        return Broken("skin ", i, ": inverseBindMatrices (accessor ", accessor, ") is not MAT4");
      if (decl.count < out.joints.size()) {
        return Broken("skin ", i, ": inverseBindMatrices (accessor ", accessor, ") has ", decl.count, " matrices for ",
                      out.joints.size(), " joints");
      }
      absl::StatusOr<std::vector<float>> values = accessors.Floats(accessor);
      if (!values.ok()) return values.status();
      for (size_t j = 0; j < out.joints.size(); ++j) {
        for (int k = 0; k < 16; ++k) out.inverse_bind_matrices[j].m[k % 4][k / 4] = (*values)[16 * j + k];
        if (!IsFinite(out.inverse_bind_matrices[j]))
          return Broken("skin ", i, ": inverse bind matrix ", j, " is not finite");
      }
    }
    budget.ShrinkTo(before + bytes);
    scene.skins.push_back(std::move(out));
  }
  return absl::OkStatus();
}

absl::Status ReadRoots(const tinygltf::Model& model, Scene& scene) {
  if (model.scenes.empty()) {
    if (scene.nodes.empty()) return absl::OkStatus();  // see AddMissingNodes
    scene.warnings.Add(WarningCode::kNoScene, "", "the file has no scenes: all nodes without a parent are used");
    std::vector<bool> child(scene.nodes.size());
    for (const Node& node : scene.nodes) {
      for (const uint32_t c : node.children) child[c] = true;
    }
    for (size_t i = 0; i < child.size(); ++i) {
      if (!child[i]) scene.roots.push_back(static_cast<uint32_t>(i));
    }
    return absl::OkStatus();
  }
  const int index = model.defaultScene < 0 ? 0 : model.defaultScene;
  std::vector<bool> seen(scene.nodes.size());
  for (const int node : model.scenes[index].nodes) {
    if (seen[node]) return Broken("scene ", index, " lists node ", node, " twice");
    seen[node] = true;
    scene.roots.push_back(static_cast<uint32_t>(node));
  }
  // A root that is also a child would be drawn twice, or with ambiguous transforms.
  for (size_t i = 0; i < scene.nodes.size(); ++i) {
    for (const uint32_t child : scene.nodes[i].children) {
      if (seen[child]) return Broken("scene ", index, " lists node ", child, ", which is a child of node ", i);
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ReadNodes(const tinygltf::Model& model, const AccessorReader& accessors, Budget& budget, Scene& scene) {
  uint64_t instances = 0;
  if (absl::Status full = budget.Take(model.nodes.size(), sizeof(Node), "nodes"); !full.ok()) return full;
  scene.nodes.reserve(model.nodes.size());
  for (size_t i = 0; i < model.nodes.size(); ++i) {
    if (i % kNodesAStep == 0) {
      if (absl::Status over = budget.job().Check(); !over.ok()) return over;
    }
    const tinygltf::Node& node = model.nodes[i];
    Node out;
    out.name = node.name;
    out.mesh = node.mesh;
    out.skin = node.skin;
    out.local = LocalTransform(node);
    out.trs = ReadTrs(node);
    out.has_matrix = node.matrix.size() == 16;
    if (!IsFinite(out.local)) return Broken("node ", i, ": its transform is not finite");
    out.children.assign(node.children.begin(), node.children.end());
    if (absl::Status bad = ReadInstances(node, accessors, budget, absl::StrCat("node ", i), instances, out);
        !bad.ok()) {
      return bad;
    }
    scene.nodes.push_back(std::move(out));
  }
  if (absl::Status bad = CheckHierarchy(model, budget.limits(), scene); !bad.ok()) return bad;
  if (absl::Status bad = ReadSkins(model, accessors, budget, scene); !bad.ok()) return bad;
  return ReadRoots(model, scene);
}

absl::Status AddMissingNodes(const Document& document, const LoadLimits& limits, Scene& scene) {
  if (!document.has_scenes && scene.nodes.empty() && !scene.meshes.empty()) {
    if (scene.meshes.size() > limits.max_nodes) {
      return absl::ResourceExhaustedError(absl::StrCat(
          "glTF: ", scene.meshes.size(), " meshes without a node; the limit max_nodes is ", limits.max_nodes));
    }
    scene.warnings.Add(WarningCode::kNoScene, "", "the file has neither scenes nor nodes: each mesh is used once");
    for (size_t i = 0; i < scene.meshes.size(); ++i) {
      scene.roots.push_back(static_cast<uint32_t>(i));
      scene.nodes.emplace_back().mesh = static_cast<int32_t>(i);
    }
  }
  if (!document.rtc_center || scene.roots.empty()) return absl::OkStatus();
  Node above;
  above.name = "CESIUM_RTC";
  above.trs.translation = *document.rtc_center;
  above.local = FromTrs(above.trs);
  above.children = std::move(scene.roots);
  scene.roots = {static_cast<uint32_t>(scene.nodes.size())};
  scene.nodes.push_back(std::move(above));
  return absl::OkStatus();
}

}  // namespace voxelpipe::gltf
