#include "load/gltf/document/gltf_sanitize.h"

#include <algorithm>

#include "load/gltf/document/gltf_fields.h"
#include "load/gltf/document/json_guard.h"

namespace voxelpipe::gltf {
namespace {

constexpr uint64_t kMaxMaterials = 100'000;  // each costs tinygltf's structures about 3 KiB

// A copy has no members that the document lacks, so that it takes no more memory.

// Sizes of the arrays that indices refer to, and the job.
struct Sizes {
  uint64_t accessors, nodes, meshes, skins, materials;
  const JobContext& job;
};

// Copies a name if it is a string; another type is no error.
void CopyName(const Json& from, Json& to) {
  const auto it = from.find("name");
  if (it != from.end() && it->is_string()) to["name"] = *it;
}

// An array of indices below `size`.
Json CopyIndices(Fields& fields, const char* key, uint64_t size, const char* target) {
  Json copy = Json::array();
  const Json* array = fields.Array(key, kMaxElements);
  if (array == nullptr) return copy;
  for (const Json& entry : *array) {
    const std::optional<uint64_t> index = AsUnsigned(entry);
    if (!index || *index >= size) {
      fields.Fail(absl::StrCat(key, " has an entry that is no index below the number of ", target, ", ", size));
      return Json::array();
    }
    copy.push_back(*index);
  }
  return copy;
}

// An array of `length` numbers (any number of them if 0).
void CopyNumbers(Fields& fields, const char* key, size_t length, Json& to) {
  const Json* array = fields.Array(key, kMaxElements);
  if (array == nullptr) return;
  for (const Json& entry : *array) {
    if (!entry.is_number()) return fields.Fail(absl::StrCat(key, " has an entry that is no number"));
  }
  if (length != 0 && array->size() != length) {
    return fields.Fail(absl::StrCat(key, " has ", array->size(), " numbers, not ", length));
  }
  to[key] = *array;
}

// True if messages can show a name from the file.
bool IsPresentable(const std::string& name) {
  constexpr size_t kMaxCharacters = 128;
  return name.size() <= kMaxCharacters && std::none_of(name.begin(), name.end(), [](char c) {
           return static_cast<unsigned char>(c) < 0x20 || c == 0x7f;
         });
}

// A map from attribute names to accessors: those that glTF defines, and application-specific ones (_NAME) if `own`, the
// list for warnings, is not null.
Json CopyAttributes(const Json& object, const std::string& where, const Sizes& sizes, absl::Status& status,
                    WarningList* own = nullptr) {
  Fields fields(object, where, status);
  Json copy = Json::object();
  size_t count = 0;
  for (const auto& [name, value] : object.items()) {
    if (!GoOn(sizes.job, count++, status)) break;
    if (name.empty()) continue;
    if (name[0] == '_') {
      if (own == nullptr) continue;
      if (!IsPresentable(name)) {
        own->Add(WarningCode::kNonconformingFile, where,
                 absl::StrCat(Quoted(name), " is no printable name and is ignored"));
        continue;
      }
    }
    const int64_t index = fields.Index(name.c_str(), sizes.accessors, "accessors");
    if (index >= 0) copy[name] = index;
  }
  return copy;
}

Json CopyPrimitive(const Json& object, const std::string& where, const Sizes& sizes, absl::Status& status,
                   WarningList& warnings) {
  Fields fields(object, where, status);
  Json copy = Json::object();
  const uint64_t mode = fields.Unsigned("mode", 4);
  if (mode > 6) fields.Fail(absl::StrCat("mode ", mode, " is none of glTF's (0 to 6)"));
  if (fields.Find("mode") != nullptr) copy["mode"] = mode;
  if (const int64_t index = fields.Index("indices", sizes.accessors, "accessors"); index >= 0) copy["indices"] = index;
  if (const Json* attributes = fields.Find("attributes")) {
    copy["attributes"] = CopyAttributes(*attributes, where + ", attributes", sizes, status, &warnings);
  }

  absl::Status material_status;
  Fields material_fields(object, where, material_status);
  const int64_t material = material_fields.Index("material", sizes.materials, "materials");
  if (material >= 0) copy["material"] = material;
  AddIgnored(material_status, where, warnings);

  if (const Json* targets = fields.Array("targets", kMaxElements)) {
    copy["targets"] = Json::array();
    for (size_t i = 0; i < targets->size() && GoOn(sizes.job, i, status); ++i) {
      copy["targets"].push_back(CopyAttributes((*targets)[i], absl::StrCat(where, ", target ", i), sizes, status));
    }
  }
  if (const Json* extensions = fields.Find("extensions"); extensions != nullptr && extensions->is_object()) {
    const auto draco = extensions->find("KHR_draco_mesh_compression");
    if (draco != extensions->end()) {
      Fields draco_fields(*draco, where + ", KHR_draco_mesh_compression", status);
      Json checked = Json::object();
      checked["bufferView"] = draco_fields.RequiredUnsigned("bufferView");
      checked["attributes"] = Json::object();
      const Json* ids = draco_fields.Find("attributes");
      if (ids == nullptr || !ids->is_object()) {
        draco_fields.Fail("attributes is not an object");
      } else {
        Fields id_fields(*ids, draco_fields.where() + ", attributes", status);
        size_t count = 0;
        for (const auto& [name, value] : ids->items()) {
          if (!GoOn(sizes.job, count++, status)) break;
          if (name.empty()) continue;
          const uint64_t id = id_fields.Unsigned(name.c_str(), 0);
          if (id > INT32_MAX) id_fields.Fail(absl::StrCat("the id ", id, " is out of range"));
          checked["attributes"][name] = id;
        }
      }
      if (checked["bufferView"].get<uint64_t>() > INT32_MAX) draco_fields.Fail("bufferView is out of range");
      copy["extensions"]["KHR_draco_mesh_compression"] = std::move(checked);
    }
  }
  return copy;
}

Json CopyMesh(const Json& object, size_t index, const Sizes& sizes, absl::Status& status, uint64_t& primitive_count,
              WarningList& warnings) {
  Fields fields(object, absl::StrCat("mesh ", index), status);
  Json copy = Json::object();
  if (!status.ok()) return copy;
  CopyName(object, copy);
  CopyNumbers(fields, "weights", 0, copy);
  copy["primitives"] = Json::array();
  const Json* primitives = fields.Array("primitives", kMaxElements);
  if (primitives == nullptr) {
    fields.Fail("primitives is missing");
    return copy;
  }
  primitive_count += primitives->size();
  if (primitive_count > kMaxElements)
    fields.Fail(absl::StrCat("the document has more than ", kMaxElements, " primitives"));
  for (size_t i = 0; i < primitives->size() && GoOn(sizes.job, i, status); ++i) {
    copy["primitives"].push_back(
        CopyPrimitive((*primitives)[i], absl::StrCat("mesh ", index, ", primitive ", i), sizes, status, warnings));
  }
  return copy;
}

// EXT_mesh_gpu_instancing and KHR_node_visibility are the two extensions of a node that change geometry.
void CopyNodeExtensions(const Fields& fields, const Sizes& sizes, Json& copy, absl::Status& status) {
  const Json* extensions = fields.Find("extensions");
  if (extensions == nullptr || !extensions->is_object()) return;
  if (const auto it = extensions->find("EXT_mesh_gpu_instancing"); it != extensions->end()) {
    Fields instancing(*it, fields.where() + ", EXT_mesh_gpu_instancing", status);
    const Json* attributes = instancing.Find("attributes");
    if (attributes == nullptr) return instancing.Fail("attributes is missing");
    copy["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        CopyAttributes(*attributes, instancing.where() + ", attributes", sizes, status);
  }
  if (const auto it = extensions->find("KHR_node_visibility"); it != extensions->end() && it->is_object()) {
    Fields visibility(*it, fields.where() + ", KHR_node_visibility", status);
    if (visibility.Find("visible") == nullptr) return;
    copy["extensions"]["KHR_node_visibility"]["visible"] = visibility.Bool("visible", true);
  }
}

Json CopyNode(const Json& object, size_t index, const Sizes& sizes, absl::Status& status) {
  Fields fields(object, absl::StrCat("node ", index), status);
  Json copy = Json::object();
  if (!status.ok()) return copy;
  CopyName(object, copy);
  if (const int64_t mesh = fields.Index("mesh", sizes.meshes, "meshes"); mesh >= 0) copy["mesh"] = mesh;
  if (const int64_t skin = fields.Index("skin", sizes.skins, "skins"); skin >= 0) copy["skin"] = skin;
  if (fields.Find("children") != nullptr) copy["children"] = CopyIndices(fields, "children", sizes.nodes, "nodes");
  CopyNumbers(fields, "matrix", 16, copy);
  CopyNumbers(fields, "translation", 3, copy);
  CopyNumbers(fields, "rotation", 4, copy);
  CopyNumbers(fields, "scale", 3, copy);
  CopyNumbers(fields, "weights", 0, copy);
  CopyNodeExtensions(fields, sizes, copy, status);
  return copy;
}

// Materials, textures, samplers and their members: only the members that the material reader uses, of any type.
Json CopyAppearance(const Json& value) {
  constexpr const char* kRead[] = {"name", "extensions",
                                   // textures and samplers
                                   "source", "sampler", "minFilter", "magFilter", "wrapS", "wrapT",
                                   "KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds",
                                   // references to textures
                                   "index", "texCoord", "KHR_texture_transform", "offset", "scale", "rotation",
                                   // materials
                                   "emissiveFactor", "emissiveTexture", "alphaMode", "alphaCutoff", "doubleSided",
                                   "pbrMetallicRoughness", "baseColorFactor", "baseColorTexture", "metallicFactor",
                                   "roughnessFactor", "metallicRoughnessTexture", "KHR_materials_emissive_strength",
                                   "emissiveStrength", "KHR_materials_pbrSpecularGlossiness", "diffuseFactor",
                                   "diffuseTexture"};
  constexpr size_t kMaxEntries = 5;  // arrays that are read have at most four; longer ones are cut but stay too long
  if (value.is_array()) {
    Json copy = Json::array();
    for (size_t i = 0; i < std::min(value.size(), kMaxEntries); ++i) {
      copy.push_back(value[i].is_structured() ? Json() : value[i]);
    }
    return copy;
  }
  if (!value.is_object()) return value;
  Json copy = Json::object();
  for (const char* key : kRead) {
    if (const auto it = value.find(key); it != value.end()) copy[key] = CopyAppearance(*it);
  }
  return copy;
}

// An array of the right number of numbers, or no member: tinygltf would otherwise drop the whole material.
void DropUnlessNumbers(Json& object, const char* key, size_t length, const std::string& where, WarningList& warnings) {
  const auto it = object.find(key);
  if (it == object.end()) return;
  bool good = it->is_array() && it->size() == length;
  if (good) {
    for (const Json& entry : *it) good = good && entry.is_number();
  }
  if (good) return;
  object.erase(it);
  warnings.Add(WarningCode::kNonconformingFile, where,
               absl::StrCat(key, " is not ", length, " numbers and is ignored"));
}

void WarnOfAlphaMode(const Json& material, const std::string& where, WarningList& warnings) {
  const auto mode = material.find("alphaMode");
  if (mode == material.end() || *mode == "OPAQUE" || *mode == "MASK" || *mode == "BLEND") return;
  warnings.Add(WarningCode::kNonconformingFile, where, "alphaMode is none of glTF's and counts as OPAQUE");
}

// `one`: the name of an element in warnings. An element that is no object becomes an empty one.
Json CopyAppearances(Fields& fields, const char* key, const char* one, const JobContext& job, absl::Status& status,
                     WarningList& warnings) {
  Json copy = Json::array();
  const Json* array = fields.Array(key, kMaxMaterials);
  if (array == nullptr) return copy;
  for (const Json& entry : *array) {
    if (!GoOn(job, copy.size(), status)) return copy;
    const std::string where = absl::StrCat(one, " ", copy.size());
    if (!entry.is_object()) {
      warnings.Add(WarningCode::kNonconformingFile, where, "is not an object and counts as an empty one");
    }
    Json element = entry.is_object() ? CopyAppearance(entry) : Json::object();
    DropUnlessNumbers(element, "emissiveFactor", 3, where, warnings);
    WarnOfAlphaMode(element, where, warnings);
    if (const auto pbr = element.find("pbrMetallicRoughness"); pbr != element.end()) {
      if (pbr->is_object()) {
        DropUnlessNumbers(*pbr, "baseColorFactor", 4, where, warnings);
      } else {
        element.erase(pbr);
        warnings.Add(WarningCode::kNonconformingFile, where, "pbrMetallicRoughness is not an object and is ignored");
      }
    }
    copy.push_back(std::move(element));
  }
  return copy;
}

void CopySkins(Fields& fields, const Sizes& sizes, Json& graph, absl::Status& status) {
  const Json* skins = fields.Array("skins", kMaxElements);
  if (skins == nullptr) return;
  for (size_t i = 0; i < skins->size() && GoOn(sizes.job, i, status); ++i) {
    Fields skin((*skins)[i], absl::StrCat("skin ", i), status);
    Json copy = Json::object();
    if (skin.Find("joints") != nullptr) copy["joints"] = CopyIndices(skin, "joints", sizes.nodes, "nodes");
    const int64_t matrices = skin.Index("inverseBindMatrices", sizes.accessors, "accessors");
    if (matrices >= 0) copy["inverseBindMatrices"] = matrices;
    graph["skins"].push_back(std::move(copy));
  }
}

void CopyScenes(Fields& fields, const Sizes& sizes, Json& graph, absl::Status& status) {
  const Json* scenes = fields.Array("scenes", kMaxElements);
  const uint64_t count = scenes == nullptr ? 0 : scenes->size();
  for (uint64_t i = 0; i < count && GoOn(sizes.job, i, status); ++i) {
    Fields scene((*scenes)[i], absl::StrCat("scene ", i), status);
    Json copy = Json::object();
    if (scene.Find("nodes") != nullptr) copy["nodes"] = CopyIndices(scene, "nodes", sizes.nodes, "nodes");
    graph["scenes"].push_back(std::move(copy));
  }
  if (const int64_t scene = fields.Index("scene", count, "scenes"); scene >= 0) graph["scene"] = scene;
}

}  // namespace

absl::StatusOr<Json> SanitizeGraph(const JobContext& job, const Json& root, const LoadLimits& limits,
                                   WarningList& warnings) {
  absl::Status status;
  Fields fields(root, "document", status);
  const Sizes sizes{ArraySize(root, "accessors"), ArraySize(root, "nodes"),     ArraySize(root, "meshes"),
                    ArraySize(root, "skins"),     ArraySize(root, "materials"), job};
  if (sizes.nodes > limits.max_nodes) {
    return absl::ResourceExhaustedError(
        absl::StrCat("glTF: ", sizes.nodes, " nodes; the limit max_nodes is ", limits.max_nodes));
  }

  Json graph = Json::object();
  uint64_t primitive_count = 0;
  if (const Json* meshes = fields.Array("meshes", kMaxElements)) {
    for (size_t i = 0; i < meshes->size() && status.ok(); ++i) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
      graph["meshes"].push_back(CopyMesh((*meshes)[i], i, sizes, status, primitive_count, warnings));
    }
  }
  if (const Json* nodes = fields.Array("nodes")) {
    for (size_t i = 0; i < nodes->size() && status.ok(); ++i) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
      graph["nodes"].push_back(CopyNode((*nodes)[i], i, sizes, status));
    }
  }
  CopySkins(fields, sizes, graph, status);
  CopyScenes(fields, sizes, graph, status);
  graph["materials"] = CopyAppearances(fields, "materials", "material", job, status, warnings);
  graph["textures"] = CopyAppearances(fields, "textures", "texture", job, status, warnings);
  graph["samplers"] = CopyAppearances(fields, "samplers", "sampler", job, status, warnings);
  if (!status.ok()) return status;
  return graph;
}

}  // namespace voxelpipe::gltf
