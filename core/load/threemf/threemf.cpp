// Sources: 3MF Consortium, "3MF Core Specification" 1.3 (2021) and its extensions (load/threemf/model.cpp); ECMA-376-2,
// "Open Packaging Conventions" (2021), for the package's relationships.
#include "load/threemf/threemf.h"

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "load/base/corner_mesh.h"
#include "load/base/flat_scene.h"
#include "load/base/load_budget.h"
#include "load/base/text_reader.h"
#include "load/threemf/model.h"
#include "load/threemf/slicer_parts.h"
#include "load/threemf/xml_events.h"
#include "load/threemf/zip_archive.h"

namespace voxelpipe {
namespace {

using threemf::Attributes;
using threemf::ModelPart;
using threemf::Object;
using threemf::PropertyGroup;
using threemf::Reference;
using threemf::Triangle;
using threemf::ZipArchive;

struct Unit {
  std::string_view name, shown;
  double metres;
};
constexpr Unit kUnits[] = {{"micron", "micron", 1e-6}, {"millimeter", "mm", 1e-3}, {"centimeter", "cm", 1e-2},
                           {"inch", "in", 0.0254},     {"foot", "ft", 0.3048},     {"meter", "m", 1}};
constexpr size_t kMaxParts = 4096;
constexpr size_t kValuesAStep = 1 << 14;   // between two polls of the job
constexpr uint64_t kBytesAMaterial = 256;  // beside itself: its place in the table, its fault

// The entry of the root model, as the package's relationships name it; else by its usual names.
absl::StatusOr<std::string> FindRoot(ZipArchive& archive, LoadBudget& budget) {
  std::string root;
  if (const std::string relationships = archive.Find("_rels/.rels"); !relationships.empty()) {
    const auto begin = [&](std::string_view name, const Attributes& attributes) {
      const char *const type = attributes.Find("Type"), *const target = attributes.Find("Target");
      if (name != "Relationship" || type == nullptr || target == nullptr || !root.empty()) return absl::OkStatus();
      const std::string_view text(type), end("/3dmodel");
      if (text.size() >= end.size() && text.substr(text.size() - end.size()) == end) root = archive.Find(target);
      return absl::OkStatus();
    };
    threemf::XmlEvents xml(relationships, budget, begin, [](std::string_view) { return absl::OkStatus(); });
    absl::Status status =
        archive.Unpack(relationships, [&](std::span<const uint8_t> piece) { return xml.Parse(piece); });
    if (status.ok()) status = xml.Finish();
    if (!status.ok()) return status;
  }
  if (root.empty()) root = archive.Find("3D/3dmodel.model");
  if (root.empty()) root = archive.FindByEnd(".model");
  if (root.empty()) return budget.Invalid("the ZIP archive has no 3D model (3D/3dmodel.model)");
  return root;
}

class SceneBuilder {
 public:
  SceneBuilder(ZipArchive& archive, LoadBudget& budget) : archive_(archive), budget_(budget) {}

  absl::StatusOr<Scene> Build(const std::string& root) {
    const absl::StatusOr<size_t> first = PartOf(root);
    if (!first.ok()) return first.status();
    if (absl::Status bad = SetUnit(); !bad.ok()) return bad;
    std::vector<Reference> items = std::move(parts_[0].build);
    if (items.empty()) {
      absl::StatusOr<std::vector<Reference>> all = ItemsWithoutBuild();
      if (!all.ok()) return all.status();
      items = *std::move(all);
    }
    for (const Reference& item : items) {
      const absl::StatusOr<uint32_t> node = AddNode(0, item, 1);
      if (!node.ok()) return node.status();
      if (absl::Status full = budget_.MakeRoom(scene_.nodes[0].children, 1, "items"); !full.ok()) return full;
      scene_.nodes[0].children.push_back(*node);
    }
    budget_.Drop(items);
    if (absl::Status bad = threemf::WarnOfSlicerParts(archive_, budget_, scene_.warnings); !bad.ok()) return bad;
    budget_.Drop(uv_);
    budget_.Drop(colors_);
    scene_.memory = budget_.Release();
    return std::move(scene_);
  }

 private:
  using Key = std::pair<size_t, int64_t>;  // a part and an id

  absl::Status SetUnit() {
    for (const Unit& unit : kUnits) {
      if (unit.name != parts_[0].unit) continue;
      scene_.unit = std::string(unit.shown);
      Node& root = scene_.nodes.emplace_back();
      root.trs.scale = {unit.metres, unit.metres, unit.metres};
      root.local = FromTrs(root.trs);
      scene_.roots = {0};
      return absl::OkStatus();
    }
    return budget_.Invalid(parts_[0].name, ": the unit ", Quote(parts_[0].unit),
                           " is none of micron, millimeter, centimeter, inch, foot, meter");
  }

  // All objects that are no component of another.
  absl::StatusOr<std::vector<Reference>> ItemsWithoutBuild() {
    std::set<int64_t> used;
    for (const auto& [id, object] : parts_[0].objects) {
      if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
      for (const Reference& component : object.components) {
        if (component.path.empty() && parts_[0].objects.count(component.object) != 0) used.insert(component.object);
      }
    }
    std::vector<Reference> items;
    for (const auto& [id, object] : parts_[0].objects) {
      if (used.count(id) != 0) continue;
      if (absl::Status full = budget_.MakeRoom(items, 1, "items"); !full.ok()) return full;
      items.push_back({"", id, Mat4d(), object.line});
    }
    if (!items.empty()) {
      scene_.warnings.Add(WarningCode::kNoScene, parts_[0].name, "the build has no items; all objects are read");
    }
    return items;
  }

  absl::StatusOr<size_t> PartOf(const std::string& entry) {
    const auto known = numbers_.find(entry);
    if (known != numbers_.end()) return known->second;
    if (parts_.size() == kMaxParts) return budget_.Invalid("more than ", kMaxParts, " model parts");
    absl::StatusOr<ModelPart> part = threemf::ReadModelPart(archive_, entry, budget_, scene_.warnings);
    if (!part.ok()) return part.status();
    if (!parts_.empty() && part->unit != parts_[0].unit) {
      scene_.warnings.Add(WarningCode::kNonconformingFile, entry,
                          absl::StrCat("the unit ", Quote(part->unit), " is ignored: that of the root model holds"));
    }
    numbers_.emplace(entry, parts_.size());
    if (absl::Status full = budget_.MakeRoom(parts_, 1, "model parts"); !full.ok()) return full;
    parts_.push_back(*std::move(part));
    return parts_.size() - 1;
  }

  // The node of an object, with those of its components. `part`: that of the reference.
  absl::StatusOr<uint32_t> AddNode(size_t part, const Reference& reference, uint32_t depth) {
    const auto bad = [&](const auto&... what) {
      return budget_.Invalid(parts_[part].name, ", line ", reference.line, ": ", what...);
    };
    if (depth > budget_.limits().max_node_depth) {
      return absl::ResourceExhaustedError(absl::StrCat("3MF: ", parts_[part].name, ", line ", reference.line,
                                                       ": more than ", budget_.limits().max_node_depth,
                                                       " levels of components; the limit is max_node_depth"));
    }
    if (scene_.nodes.size() >= budget_.limits().max_nodes) {
      return absl::ResourceExhaustedError(
          absl::StrCat("3MF: more than ", budget_.limits().max_nodes, " items and components; the limit is max_nodes"));
    }
    size_t of = part;
    if (!reference.path.empty()) {
      const std::string entry = archive_.Find(reference.path);
      if (entry.empty()) return bad("the part ", Quote(reference.path), " does not exist");
      const absl::StatusOr<size_t> found = PartOf(entry);
      if (!found.ok()) return found.status();
      of = *found;
    }
    const Key key{of, reference.object};
    if (parts_[of].objects.count(reference.object) == 0) return bad("object ", reference.object, " does not exist");
    if (open_.count(key) != 0) return bad("object ", reference.object, " is a component of itself");
    if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
    if (absl::Status full = budget_.MakeRoom(scene_.nodes, 1, "components"); !full.ok()) return full;
    const auto index = uint32_t(scene_.nodes.size());
    Node& node = scene_.nodes.emplace_back();
    node.local = reference.transform;
    node.has_matrix = true;
    const absl::StatusOr<int32_t> mesh = MeshOf(key);
    if (!mesh.ok()) return mesh.status();
    scene_.nodes[index].mesh = *mesh;
    open_.insert(key);
    // By index: further parts may come, and move the list of parts.
    for (size_t i = 0; i < parts_[of].objects[reference.object].components.size(); ++i) {
      const Reference component = parts_[of].objects[reference.object].components[i];
      const absl::StatusOr<uint32_t> child = AddNode(of, component, depth + 1);
      if (!child.ok()) return child.status();
      std::vector<uint32_t>& children = scene_.nodes[index].children;
      if (absl::Status full = budget_.MakeRoom(children, 1, "components"); !full.ok()) return full;
      children.push_back(*child);
    }
    open_.erase(key);
    return index;
  }

  // The mesh of an object, -1 if it has no triangles. The same for all uses.
  absl::StatusOr<int32_t> MeshOf(const Key& key) {
    const auto known = meshes_.find(key);
    if (known != meshes_.end()) return known->second;
    Object& object = parts_[key.first].objects[key.second];
    int32_t& mesh = meshes_.emplace(key, -1).first->second;
    if (object.triangles.empty()) return mesh;
    CornerMesh corners({&object.vertices, &uv_, nullptr, &colors_}, budget_);
    for (const Triangle& triangle : object.triangles) {
      if (absl::Status bad = AddTriangle(key.first, triangle, corners); !bad.ok()) return bad;
    }
    if (absl::Status full = budget_.Take(1, object.name.size(), "objects"); !full.ok()) return full;
    if (absl::Status full = budget_.MakeRoom(scene_.meshes, 1, "objects"); !full.ok()) return full;
    mesh = int32_t(scene_.meshes.size());
    scene_.meshes.push_back(Mesh{object.name, corners.Take(scene_.warnings)});
    budget_.Drop(object.vertices);
    budget_.Drop(object.triangles);
    return mesh;
  }

  // The first of a group's values in uv_ or colors_, where they are put once, whatever the number of objects that use
  // them.
  absl::StatusOr<uint64_t> PlaceOf(const Key& key, const PropertyGroup& group) {
    const bool texture = group.kind == PropertyGroup::Kind::kTexture;
    const auto [place, fresh] = places_.try_emplace(key, texture ? uv_.size() : colors_.size());
    if (!fresh) return place->second;
    const uint64_t count = texture ? group.uv.size() : group.colors.size();
    if (place->second + count >= CornerMesh::kNone) return budget_.Invalid("too many values of properties");
    absl::Status status =
        texture ? budget_.MakeRoom(uv_, count, "texture coordinates") : budget_.MakeRoom(colors_, count, "colours");
    for (size_t i = 0; i < count && status.ok(); ++i) {
      if (i % kValuesAStep == 0) status = budget_.job().Check();
      if (texture) {
        uv_.push_back({group.uv[i].x, 1 - group.uv[i].y});
      } else {
        colors_.push_back(LinearColor(group.colors[i]));
      }
    }
    if (!status.ok()) return status;
    return place->second;
  }

  absl::Status AddTriangle(size_t part, const Triangle& triangle, CornerMesh& corners) {
    CornerMesh::Corner polygon[3];
    for (size_t i = 0; i < 3; ++i) polygon[i].position = triangle.vertices[i];
    int32_t material = -1;
    const auto& groups = parts_[part].groups;
    const auto found = groups.find(triangle.group);
    if (found != groups.end() && found->second.kind != PropertyGroup::Kind::kOther) {
      const PropertyGroup& group = found->second;
      const bool texture = group.kind == PropertyGroup::Kind::kTexture;
      const uint64_t count = texture ? group.uv.size() : group.colors.size();
      for (const int64_t property : triangle.properties) {
        if (uint64_t(property) < count) continue;
        WarnOfProperty(part, triangle.group, property, count);
        return corners.AddPolygon(polygon, -1);
      }
      if (group.kind == PropertyGroup::Kind::kMaterials) {
        const absl::StatusOr<int32_t> base = BaseMaterial({part, triangle.group}, group, triangle.properties[0]);
        if (!base.ok()) return base.status();
        return corners.AddPolygon(polygon, *base);
      }
      const absl::StatusOr<uint64_t> place = PlaceOf({part, triangle.group}, group);
      if (!place.ok()) return place.status();
      for (size_t i = 0; i < 3; ++i) {
        (texture ? polygon[i].uv : polygon[i].color) = uint32_t(*place + uint64_t(triangle.properties[i]));
      }
      if (texture) {
        const absl::StatusOr<int32_t> textured = TexturedMaterial({part, triangle.group}, group);
        if (!textured.ok()) return textured.status();
        material = *textured;
      }
    } else if (found == groups.end() && triangle.group != Triangle::kNone) {
      WarnOfProperty(part, triangle.group, 0, 0);
    }
    return corners.AddPolygon(polygon, material);
  }

  void WarnOfProperty(size_t part, int64_t group, int64_t property, uint64_t count) {
    scene_.warnings.Add(WarningCode::kNonconformingFile, parts_[part].name,
                        count == 0 ? absl::StrCat("the group of properties ", group, " does not exist")
                                   : absl::StrCat("the group of properties ", group, " has no index ", property));
  }

  absl::StatusOr<int32_t> NewMaterial(std::string name) {
    if (absl::Status full = budget_.Take(kBytesAMaterial + name.size(), 1, "materials"); !full.ok()) return full;
    if (absl::Status full = budget_.MakeRoom(scene_.materials, 1, "materials"); !full.ok()) return full;
    Material& material = scene_.materials.emplace_back();
    material.name = std::move(name);
    material.metallic_factor = 0;
    return int32_t(scene_.materials.size() - 1);
  }

  absl::StatusOr<int32_t> BaseMaterial(const Key& key, const PropertyGroup& group, int64_t index) {
    const auto [at, fresh] = materials_.try_emplace({key, index}, -1);
    if (!fresh) return at->second;
    absl::StatusOr<int32_t> id = NewMaterial(group.names[size_t(index)]);
    if (!id.ok()) return id;
    Material& material = scene_.materials[size_t(*id)];
    material.base_color_factor = LinearColor(group.colors[size_t(index)]);
    if (material.base_color_factor.w < 1) material.alpha_mode = AlphaMode::kBlend;
    return at->second = *id;
  }

  absl::StatusOr<int32_t> TexturedMaterial(const Key& key, const PropertyGroup& group) {
    const auto [at, fresh] = materials_.try_emplace({key, -1}, -1);
    if (!fresh) return at->second;
    absl::StatusOr<int32_t> id = NewMaterial("");
    if (!id.ok()) return id;
    at->second = *id;
    TextureRef ref;
    const auto& textures = parts_[key.first].textures;
    const auto found = textures.find(group.texture);
    if (found == textures.end()) {
      ref.fault = absl::StrCat("the texture ", group.texture, " does not exist");
    } else {
      const threemf::Texture2d& from = found->second;
      const absl::StatusOr<int32_t> image = ImageOf(from, ref.fault);
      if (!image.ok()) return image.status();
      if (*image >= 0) {
        Texture texture;
        texture.image = *image;
        const auto wrap = [](bool clamp, bool mirror) {
          return clamp ? WrapMode::kClampToEdge : (mirror ? WrapMode::kMirroredRepeat : WrapMode::kRepeat);
        };
        texture.wrap_s = wrap(from.clamp_u, from.mirror_u);
        texture.wrap_t = wrap(from.clamp_v, from.mirror_v);
        texture.nearest = texture.min_nearest = from.nearest;
        if (absl::Status full = budget_.MakeRoom(scene_.textures, 1, "textures"); !full.ok()) return full;
        ref.texture = int32_t(scene_.textures.size());
        scene_.textures.push_back(texture);
      }
    }
    scene_.materials[size_t(*id)].base_color = ref;
    return *id;
  }

  absl::StatusOr<int32_t> ImageOf(const threemf::Texture2d& texture, std::string& fault) {
    const std::string entry = archive_.Find(texture.path);
    if (entry.empty()) {
      fault = absl::StrCat("the entry ", Quote(texture.path), " does not exist");
      return -1;
    }
    const auto [at, fresh] = images_.try_emplace(entry, -1);
    if (!fresh) return at->second;
    MemoryCharge charge(&MemoryOf(budget_.job()));
    if (absl::Status full = charge.Grow(archive_.SizeOf(entry) + sizeof(Image), "3MF: a texture:"); !full.ok()) {
      return full;
    }
    auto image = std::make_shared<Image>();
    image->name = entry;
    image->mime_type = texture.content_type;
    image->encoded.reserve(archive_.SizeOf(entry));
    absl::Status status = archive_.Unpack(entry, [&](std::span<const uint8_t> piece) {
      image->encoded.insert(image->encoded.end(), piece.begin(), piece.end());
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
    image->memory = std::make_shared<MemoryCharge>(std::move(charge));
    if (absl::Status full = budget_.MakeRoom(scene_.images, 1, "textures"); !full.ok()) return full;
    at->second = int32_t(scene_.images.size());
    scene_.images.push_back(std::move(image));
    return at->second;
  }

  ZipArchive& archive_;
  LoadBudget& budget_;
  Scene scene_;
  std::vector<ModelPart> parts_;
  std::map<std::string, size_t> numbers_;  // of parts, by entry
  std::map<Key, int32_t> meshes_;
  std::vector<Vec2f> uv_;                                 // of the groups of properties that triangles use
  std::vector<Vec4f> colors_;                             // likewise, linear
  std::map<Key, uint64_t> places_;                        // of the groups' values in those
  std::map<std::pair<Key, int64_t>, int32_t> materials_;  // by group and index, -1 for that of a texture
  std::map<std::string, int32_t> images_;                 // by entry
  std::set<Key> open_;                                    // objects on the way from the root to the current node
};

}  // namespace

absl::StatusOr<Scene> Load3mf(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  LoadBudget budget(job, limits, "3MF");
  absl::StatusOr<ZipArchive> archive = ZipArchive::Open(bytes, budget);
  if (!archive.ok()) return archive.status();
  const absl::StatusOr<std::string> root = FindRoot(*archive, budget);
  if (!root.ok()) return root.status();
  return SceneBuilder(*archive, budget).Build(*root);
}

}  // namespace voxelpipe
