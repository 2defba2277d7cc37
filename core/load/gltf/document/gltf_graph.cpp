// Source: Khronos Group, "glTF 2.0 Specification" (2021), the defaults of its properties. tinygltf's own parser is not
// used: it would need another copy of the text, report no progress, and check no limit.
#include "load/gltf/document/gltf_graph.h"

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "load/gltf/document/gltf_model.h"

namespace voxelpipe::gltf {
namespace {

using Json = nlohmann::json;

const Json* Find(const Json& object, const char* key) {
  const auto it = object.find(key);
  return it == object.end() ? nullptr : &*it;
}

// Numbers, strings and flags of a checked graph; members of another type count as absent.
int IntOf(const Json& object, const char* key, int fallback) {
  const Json* const value = Find(object, key);
  if (value == nullptr || !value->is_number_integer()) return fallback;
  return static_cast<int>(value->get<int64_t>());
}

double NumberOf(const Json& object, const char* key, double fallback) {
  const Json* const value = Find(object, key);
  return value != nullptr && value->is_number() ? value->get<double>() : fallback;
}

std::string StringOf(const Json& object, const char* key, const std::string& fallback = "") {
  const Json* const value = Find(object, key);
  return value != nullptr && value->is_string() ? value->get<std::string>() : fallback;
}

std::vector<double> NumbersOf(const Json& object, const char* key) {
  std::vector<double> out;
  const Json* const array = Find(object, key);
  if (array == nullptr || !array->is_array()) return out;
  out.reserve(array->size());
  for (const Json& number : *array) {
    if (!number.is_number()) return {};
    out.push_back(number.get<double>());
  }
  return out;
}

std::vector<int> IndicesOf(const Json& object, const char* key) {
  std::vector<int> out;
  const Json* const array = Find(object, key);
  if (array == nullptr) return out;
  out.reserve(array->size());
  for (const Json& index : *array) out.push_back(static_cast<int>(index.get<int64_t>()));
  return out;
}

// A map from names to accessors; empty if `json` is null.
std::map<std::string, int> AttributesOf(const Json* json) {
  std::map<std::string, int> out;
  if (json == nullptr) return out;
  const Json& object = *json;
  for (const auto& [name, accessor] : object.items()) out[name] = static_cast<int>(accessor.get<int64_t>());
  return out;
}

tinygltf::Value ToValue(const Json& json) {
  switch (json.type()) {
    case Json::value_t::boolean: return tinygltf::Value(json.get<bool>());
    case Json::value_t::string: return tinygltf::Value(json.get<std::string>());
    case Json::value_t::number_integer:
    case Json::value_t::number_unsigned: {
      const double number = json.get<double>();
      return number >= INT32_MIN && number <= INT32_MAX ? tinygltf::Value(static_cast<int>(number))
                                                        : tinygltf::Value(number);
    }
    case Json::value_t::number_float: return tinygltf::Value(json.get<double>());
    case Json::value_t::array: {
      tinygltf::Value::Array array;
      for (const Json& entry : json) array.push_back(ToValue(entry));
      return tinygltf::Value(std::move(array));
    }
    case Json::value_t::object: {
      tinygltf::Value::Object object;
      for (const auto& [key, entry] : json.items()) object.emplace(key, ToValue(entry));
      return tinygltf::Value(std::move(object));
    }
    default: return tinygltf::Value();
  }
}

// Bytes of a value; far more than in the JSON.
uint64_t ValueBytes(const Json& json) {
  constexpr uint64_t kMemberBytes = sizeof(tinygltf::Value) + 80;  // with its key in a tree
  uint64_t bytes = sizeof(tinygltf::Value);
  if (json.is_string()) bytes += json.get_ref<const std::string&>().size();
  if (!json.is_structured()) return bytes;
  for (const auto& [key, entry] : json.items()) bytes += kMemberBytes + key.size() + ValueBytes(entry);
  return bytes;
}

// Bytes of the extensions of an element and of the objects in it.
uint64_t ExtensionBytes(const Json& element) {
  uint64_t bytes = 0;
  if (!element.is_object()) return bytes;
  for (const auto& [key, entry] : element.items()) {
    bytes += key == "extensions" ? ValueBytes(entry) : ExtensionBytes(entry);
  }
  return bytes;
}

tinygltf::ExtensionMap ExtensionsOf(const Json& object) {
  tinygltf::ExtensionMap out;
  const Json* const extensions = Find(object, "extensions");
  if (extensions == nullptr || !extensions->is_object()) return out;
  for (const auto& [name, extension] : extensions->items()) {
    if (extension.is_object()) out[name] = ToValue(extension);
  }
  return out;
}

tinygltf::Primitive ToPrimitive(const Json& json) {
  tinygltf::Primitive out;
  out.mode = IntOf(json, "mode", 4);
  out.indices = IntOf(json, "indices", -1);
  out.material = IntOf(json, "material", -1);
  out.attributes = AttributesOf(Find(json, "attributes"));
  if (const Json* const targets = Find(json, "targets")) {
    for (const Json& target : *targets) out.targets.push_back(AttributesOf(&target));
  }
  out.extensions = ExtensionsOf(json);
  return out;
}

// Without its primitives.
tinygltf::Mesh ToMesh(const Json& json) {
  tinygltf::Mesh out;
  out.name = StringOf(json, "name");
  out.weights = NumbersOf(json, "weights");
  return out;
}

tinygltf::Node ToNode(const Json& json) {
  tinygltf::Node out;
  out.name = StringOf(json, "name");
  out.mesh = IntOf(json, "mesh", -1);
  out.skin = IntOf(json, "skin", -1);
  out.children = IndicesOf(json, "children");
  out.matrix = NumbersOf(json, "matrix");
  out.translation = NumbersOf(json, "translation");
  out.rotation = NumbersOf(json, "rotation");
  out.scale = NumbersOf(json, "scale");
  out.weights = NumbersOf(json, "weights");
  out.extensions = ExtensionsOf(json);
  return out;
}

tinygltf::Skin ToSkin(const Json& json) {
  tinygltf::Skin out;
  out.joints = IndicesOf(json, "joints");
  out.inverseBindMatrices = IntOf(json, "inverseBindMatrices", -1);
  return out;
}

tinygltf::Scene ToScene(const Json& json) {
  tinygltf::Scene out;
  out.nodes = IndicesOf(json, "nodes");
  return out;
}

tinygltf::TextureInfo ToTextureInfo(const Json& object, const char* key) {
  tinygltf::TextureInfo out;
  const Json* const json = Find(object, key);
  if (json == nullptr || !json->is_object()) return out;
  out.index = IntOf(*json, "index", -1);
  out.texCoord = IntOf(*json, "texCoord", 0);
  out.extensions = ExtensionsOf(*json);
  return out;
}

tinygltf::Material ToMaterial(const Json& json) {
  tinygltf::Material out;
  out.name = StringOf(json, "name");
  out.emissiveFactor = NumbersOf(json, "emissiveFactor");
  if (out.emissiveFactor.empty()) out.emissiveFactor = {0, 0, 0};
  out.emissiveTexture = ToTextureInfo(json, "emissiveTexture");
  out.alphaMode = StringOf(json, "alphaMode", "OPAQUE");
  out.alphaCutoff = NumberOf(json, "alphaCutoff", 0.5);
  const Json* const double_sided = Find(json, "doubleSided");
  out.doubleSided = double_sided != nullptr && double_sided->is_boolean() && double_sided->get<bool>();
  out.extensions = ExtensionsOf(json);
  const Json* const pbr = Find(json, "pbrMetallicRoughness");
  if (pbr == nullptr) return out;
  tinygltf::PbrMetallicRoughness& to = out.pbrMetallicRoughness;
  if (std::vector<double> factor = NumbersOf(*pbr, "baseColorFactor"); !factor.empty()) {
    to.baseColorFactor = std::move(factor);
  }
  to.baseColorTexture = ToTextureInfo(*pbr, "baseColorTexture");
  to.metallicFactor = NumberOf(*pbr, "metallicFactor", 1);
  to.roughnessFactor = NumberOf(*pbr, "roughnessFactor", 1);
  to.metallicRoughnessTexture = ToTextureInfo(*pbr, "metallicRoughnessTexture");
  return out;
}

tinygltf::Texture ToTexture(const Json& json) {
  tinygltf::Texture out;
  out.source = IntOf(json, "source", -1);
  out.sampler = IntOf(json, "sampler", -1);
  out.extensions = ExtensionsOf(json);
  return out;
}

tinygltf::Sampler ToSampler(const Json& json) {
  tinygltf::Sampler out;
  out.minFilter = IntOf(json, "minFilter", -1);
  out.magFilter = IntOf(json, "magFilter", -1);
  out.wrapS = IntOf(json, "wrapS", TINYGLTF_TEXTURE_WRAP_REPEAT);
  out.wrapT = IntOf(json, "wrapT", TINYGLTF_TEXTURE_WRAP_REPEAT);
  return out;
}

// The array graph[key], each element converted by `convert`. Without its extensions an element takes less memory than
// in the JSON, which the document has charged.
template <typename Element>
absl::Status Convert(const Json& graph, const char* key, Element (*convert)(const Json&), const Budget& budget,
                     MemoryCharge& charge, std::vector<Element>& out) {
  constexpr size_t kStep = 1024;  // elements between two polls of the job
  const Json* const array = Find(graph, key);
  if (array == nullptr || !array->is_array()) return absl::OkStatus();
  if (absl::Status full = budget.Take(array->size(), sizeof(Element), key, charge); !full.ok()) return full;
  out.reserve(array->size());
  for (size_t i = 0; i < array->size(); ++i) {
    if (i % kStep == 0) {
      if (absl::Status over = budget.job().Check(); !over.ok()) return over;
    }
    const Json& element = (*array)[i];
    if (const uint64_t more = ExtensionBytes(element); more > 0) {
      if (absl::Status full = budget.Take(more, 1, key, charge); !full.ok()) return full;
    }
    out.push_back(convert(element));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<tinygltf::Model> BuildModel(const Json& graph, const Budget& budget, MemoryCharge& charge) {
  tinygltf::Model model;
  model.defaultScene = IntOf(graph, "scene", -1);
  const auto convert = [&](const char* key, auto function, auto& out) {
    return Convert(graph, key, function, budget, charge, out);
  };
  if (absl::Status s = convert("scenes", ToScene, model.scenes); !s.ok()) return s;
  if (absl::Status s = convert("nodes", ToNode, model.nodes); !s.ok()) return s;
  if (absl::Status s = convert("meshes", ToMesh, model.meshes); !s.ok()) return s;
  for (size_t i = 0; i < model.meshes.size(); ++i) {
    const Json& mesh = graph.at("meshes")[i];
    absl::Status s = Convert(mesh, "primitives", ToPrimitive, budget, charge, model.meshes[i].primitives);
    if (!s.ok()) return s;
  }
  if (absl::Status s = convert("skins", ToSkin, model.skins); !s.ok()) return s;
  if (absl::Status s = convert("materials", ToMaterial, model.materials); !s.ok()) return s;
  if (absl::Status s = convert("textures", ToTexture, model.textures); !s.ok()) return s;
  if (absl::Status s = convert("samplers", ToSampler, model.samplers); !s.ok()) return s;
  return model;
}

}  // namespace voxelpipe::gltf
