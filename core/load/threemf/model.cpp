// Sources: 3MF Consortium, "3MF Core Specification" 1.3 (2021), "Materials and Properties Extension" 1.2.1 (2020),
// "Production Extension" 1.1.2 (2021).
#include "load/threemf/model.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "load/base/flat_scene.h"
#include "load/base/text_reader.h"
#include "load/threemf/xml_events.h"

namespace voxelpipe::threemf {
namespace {

// Elements whose contents do not change the triangles or their colours, or that only group others.
constexpr std::string_view kSilent[] = {"resources", "build",     "components", "mesh",
                                        "vertices",  "triangles", "metadata",   "metadatagroup"};

std::optional<int> HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return std::nullopt;
}

// "#RRGGBB" or "#RRGGBBAA".
std::optional<Vec4f> ColorOf(std::string_view text) {
  if (text.empty() || text[0] != '#' || (text.size() != 7 && text.size() != 9)) return std::nullopt;
  Vec4f color{0, 0, 0, 1};
  for (size_t i = 1; i + 1 < text.size(); i += 2) {
    const std::optional<int> high = HexDigit(text[i]), low = HexDigit(text[i + 1]);
    if (!high || !low) return std::nullopt;
    color[int(i / 2)] = float(*high * 16 + *low) / 255.0f;
  }
  return color;
}

class PartReader {
 public:
  PartReader(const std::string& entry, LoadBudget& budget, WarningList& warnings)
      : budget_(budget),
        warnings_(warnings),
        xml_(
            entry, budget,
            [this](std::string_view name, const Attributes& attributes) { return Begin(name, attributes); },
            [this](std::string_view name) { return End(name); }) {
    part_.name = entry;
  }

  absl::StatusOr<ModelPart> Read(ZipArchive& archive) {
    absl::Status status =
        archive.Unpack(part_.name, [this](std::span<const uint8_t> piece) { return xml_.Parse(piece); });
    if (status.ok()) status = xml_.Finish();
    if (!status.ok()) return status;
    if (!is_model_) return budget_.Invalid(part_.name, ": no element 'model'");
    return std::move(part_);
  }

 private:
  template <typename... Parts>
  absl::Status Bad(const Parts&... what) const {
    return budget_.Invalid(part_.name, ", line ", xml_.line(), ": ", what...);
  }

  // The attribute as an integer from 0; empty if there is none.
  absl::StatusOr<std::optional<int64_t>> Id(const Attributes& attributes, std::string_view name) const {
    const char* const text = attributes.Find(name);
    if (text == nullptr) return std::optional<int64_t>();
    int64_t value = 0;
    if (!ReadInteger(text, value) || value < 0) return Bad(std::string(name), "=", Quote(text), " is no index");
    return std::optional<int64_t>(value);
  }
  absl::StatusOr<int64_t> NeededId(const Attributes& attributes, std::string_view name) const {
    const absl::StatusOr<std::optional<int64_t>> id = Id(attributes, name);
    if (!id.ok()) return id.status();
    if (!*id) return Bad("the attribute '", std::string(name), "' is missing");
    return **id;
  }
  // Its float is finite.
  absl::StatusOr<double> Number(const Attributes& attributes, std::string_view name) const {
    const char* const text = attributes.Find(name);
    if (text == nullptr) return Bad("the attribute '", std::string(name), "' is missing");
    double value = 0;
    if (!ReadReal(Words(text).Next(), value)) return Bad(std::string(name), "=", Quote(text), " is no number");
    if (!IsFinite(static_cast<float>(value))) return Bad(std::string(name), "=", Quote(text), " is not finite");
    return value;
  }
  static std::string Text(const Attributes& attributes, std::string_view name) {
    const char* const text = attributes.Find(name);
    return text == nullptr ? std::string() : std::string(text);
  }

  // Twelve numbers of a matrix for row vectors: the last three move.
  absl::StatusOr<Mat4d> Transform(const Attributes& attributes) const {
    Mat4d matrix;
    const char* const text = attributes.Find("transform");
    if (text == nullptr) return matrix;
    WordStream words(text, 1);
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 3; ++column) {
        double value = 0;
        const std::string_view word = words.Next();
        if (!ReadReal(word, value) || !IsFinite(static_cast<float>(value)))
          return Bad("transform: ", Quote(word), " is no number");
        matrix.m[column][row] = value;
      }
    }
    if (!words.Next().empty()) return Bad("transform: more than twelve numbers");
    return matrix;
  }

  absl::Status Begin(std::string_view name, const Attributes& attributes) {
    if (!is_model_) {
      if (name != "model") return Bad("the first element is ", Quote(name), ", not 'model'");
      is_model_ = true;
      if (const char* const unit = attributes.Find("unit")) part_.unit = unit;
      return absl::OkStatus();
    }
    if (name == "vertex") return Vertex(attributes);
    if (name == "triangle") return AddTriangle(attributes);
    if (name == "object") return BeginObject(attributes);
    if (name == "mesh") BeginMesh();
    if (name == "component" || name == "item") return AddReference(name == "item", attributes);
    if (name == "basematerials") return BeginGroup(PropertyGroup::Kind::kMaterials, attributes);
    if (name == "colorgroup") return BeginGroup(PropertyGroup::Kind::kColors, attributes);
    if (name == "texture2dgroup") return BeginGroup(PropertyGroup::Kind::kTexture, attributes);
    if (name == "base") return AddColor("displaycolor", attributes);
    if (name == "color") return AddColor("color", attributes);
    if (name == "tex2coord") return AddUv(attributes);
    if (name == "texture2d") return AddTexture(attributes);
    if (std::find(std::begin(kSilent), std::end(kSilent), name) != std::end(kSilent)) return absl::OkStatus();
    if (name == "compositematerials" || name == "multiproperties") {
      if (absl::Status bad = BeginGroup(PropertyGroup::Kind::kOther, attributes); !bad.ok()) return bad;
    }
    if (name == "composite" || name == "multi") return absl::OkStatus();
    if (std::find(ignored_.begin(), ignored_.end(), name) == ignored_.end() && ignored_.size() < kMaxIgnored) {
      ignored_.emplace_back(name);
      warnings_.Add(WarningCode::kExtensionIgnored, absl::StrCat(part_.name, ", line ", xml_.line()),
                    absl::StrCat("the element ", Quote(name), " is ignored"));
    }
    return absl::OkStatus();
  }

  absl::Status End(std::string_view name) {
    if (name == "object") object_ = nullptr;
    if (name == "basematerials" || name == "colorgroup" || name == "texture2dgroup" || name == "compositematerials" ||
        name == "multiproperties") {
      group_ = nullptr;
    }
    return absl::OkStatus();
  }

  absl::Status BeginObject(const Attributes& attributes) {
    const absl::StatusOr<int64_t> id = NeededId(attributes, "id");
    if (!id.ok()) return id.status();
    const absl::StatusOr<std::optional<int64_t>> group = Id(attributes, "pid"), property = Id(attributes, "pindex");
    if (!group.ok()) return group.status();
    if (!property.ok()) return property.status();
    if (absl::Status full = budget_.Take(1, kBytesAResource, "objects"); !full.ok()) return full;
    const auto [at, fresh] = part_.objects.try_emplace(*id);
    if (!fresh) return Bad("a second object ", *id);
    object_ = &at->second;
    object_->id = *id;
    object_->name = Text(attributes, "name").substr(0, kMaxNameBytes);
    object_->group = group->value_or(Triangle::kNone);
    object_->property = property->value_or(0);
    object_->line = xml_.line();
    mesh_begin_ = 0;
    return absl::OkStatus();
  }

  // Objects have one mesh; some exporters write several, each with indices of its own.
  void BeginMesh() {
    if (object_ == nullptr) return;
    mesh_begin_ = object_->vertices.size();
    if (mesh_begin_ > 0) {
      warnings_.Add(WarningCode::kNonconformingFile, absl::StrCat(part_.name, ", line ", xml_.line()),
                    absl::StrCat("another mesh in object ", object_->id, ", which may have one; it is added"));
    }
  }

  absl::Status Vertex(const Attributes& attributes) {
    if (object_ == nullptr) return Bad("a vertex outside an object");
    Vec3d p;
    constexpr std::string_view kAxes[] = {"x", "y", "z"};
    for (int axis = 0; axis < 3; ++axis) {
      const absl::StatusOr<double> value = Number(attributes, kAxes[axis]);
      if (!value.ok()) return value.status();
      p[axis] = *value;
    }
    if (absl::Status full = budget_.CheckVertices(++vertices_); !full.ok()) return full;
    if (absl::Status full = budget_.MakeRoom(object_->vertices, 1, "vertices"); !full.ok()) return full;
    object_->vertices.push_back(p);
    return absl::OkStatus();
  }

  absl::Status AddTriangle(const Attributes& attributes) {
    if (object_ == nullptr) return Bad("a triangle outside an object");
    Triangle triangle;
    constexpr std::string_view kVertices[] = {"v1", "v2", "v3"}, kProperties[] = {"p1", "p2", "p3"};
    for (size_t i = 0; i < 3; ++i) {
      const absl::StatusOr<int64_t> vertex = NeededId(attributes, kVertices[i]);
      if (!vertex.ok()) return vertex.status();
      const uint64_t of_mesh = object_->vertices.size() - mesh_begin_;
      if (uint64_t(*vertex) >= of_mesh) {
        return Bad("vertex ", *vertex, " does not exist: object ", object_->id, " has ", of_mesh);
      }
      triangle.vertices[i] = uint32_t(mesh_begin_ + uint64_t(*vertex));
    }
    const absl::StatusOr<std::optional<int64_t>> group = Id(attributes, "pid"), first = Id(attributes, "p1");
    if (!group.ok()) return group.status();
    if (!first.ok()) return first.status();
    triangle.group = first->has_value() ? group->value_or(object_->group) : object_->group;
    triangle.properties.fill(first->value_or(object_->property));
    for (size_t i = 1; i < 3 && first->has_value(); ++i) {
      const absl::StatusOr<std::optional<int64_t>> other = Id(attributes, kProperties[i]);
      if (!other.ok()) return other.status();
      triangle.properties[i] = other->value_or(**first);
    }
    if (absl::Status full = budget_.CheckTriangles(++triangles_); !full.ok()) return full;
    if (absl::Status full = budget_.MakeRoom(object_->triangles, 1, "triangles"); !full.ok()) return full;
    object_->triangles.push_back(triangle);
    return absl::OkStatus();
  }

  absl::Status AddReference(bool item, const Attributes& attributes) {
    if (!item && object_ == nullptr) return Bad("a component outside an object");
    const absl::StatusOr<int64_t> id = NeededId(attributes, "objectid");
    if (!id.ok()) return id.status();
    const absl::StatusOr<Mat4d> transform = Transform(attributes);
    if (!transform.ok()) return transform.status();
    std::vector<Reference>& list = item ? part_.build : object_->components;
    if (absl::Status full = budget_.MakeRoom(list, 1, "components"); !full.ok()) return full;
    std::string path = Text(attributes, "path");
    if (absl::Status full = budget_.Take(path.size(), 1, "components"); !full.ok()) return full;
    list.push_back({std::move(path), *id, *transform, xml_.line()});
    return absl::OkStatus();
  }

  absl::Status BeginGroup(PropertyGroup::Kind kind, const Attributes& attributes) {
    const absl::StatusOr<int64_t> id = NeededId(attributes, "id");
    if (!id.ok()) return id.status();
    const absl::StatusOr<std::optional<int64_t>> texture = Id(attributes, "texid");
    if (!texture.ok()) return texture.status();
    if (absl::Status full = budget_.Take(1, kBytesAResource, "resources"); !full.ok()) return full;
    const auto [at, fresh] = part_.groups.try_emplace(*id);
    if (!fresh) return Bad("a second group of properties ", *id);
    group_ = &at->second;
    group_->kind = kind;
    group_->texture = texture->value_or(-1);
    return absl::OkStatus();
  }

  absl::Status AddColor(std::string_view attribute, const Attributes& attributes) {
    if (group_ == nullptr || group_->kind == PropertyGroup::Kind::kTexture) return absl::OkStatus();
    const std::string text = Text(attributes, attribute);
    std::optional<Vec4f> color = ColorOf(text);
    if (!color && !std::exchange(warned_of_colors_, true)) {
      warnings_.Add(WarningCode::kNonconformingFile, absl::StrCat(part_.name, ", line ", xml_.line()),
                    absl::StrCat(std::string(attribute), "=", Quote(text), " is no colour #RRGGBB or #RRGGBBAA; it is ",
                                 "white here and below"));
    }
    if (absl::Status full = budget_.MakeRoom(group_->colors, 1, "colours"); !full.ok()) return full;
    group_->colors.push_back(color.value_or(Vec4f{1, 1, 1, 1}));
    if (group_->kind != PropertyGroup::Kind::kMaterials) return absl::OkStatus();
    if (absl::Status full = budget_.MakeRoom(group_->names, 1, "materials"); !full.ok()) return full;
    std::string name = Text(attributes, "name").substr(0, kMaxNameBytes);
    if (absl::Status full = budget_.Take(name.size(), 1, "materials"); !full.ok()) return full;
    group_->names.push_back(std::move(name));
    return absl::OkStatus();
  }

  absl::Status AddUv(const Attributes& attributes) {
    if (group_ == nullptr || group_->kind != PropertyGroup::Kind::kTexture) return absl::OkStatus();
    const absl::StatusOr<double> u = Number(attributes, "u"), v = Number(attributes, "v");
    if (!u.ok()) return u.status();
    if (!v.ok()) return v.status();
    if (absl::Status full = budget_.MakeRoom(group_->uv, 1, "texture coordinates"); !full.ok()) return full;
    group_->uv.push_back({static_cast<float>(*u), static_cast<float>(*v)});
    return absl::OkStatus();
  }

  absl::Status AddTexture(const Attributes& attributes) {
    const absl::StatusOr<int64_t> id = NeededId(attributes, "id");
    if (!id.ok()) return id.status();
    if (absl::Status full = budget_.Take(1, kBytesAResource, "resources"); !full.ok()) return full;
    Texture2d& texture = part_.textures[*id];
    texture.path = Text(attributes, "path").substr(0, kMaxNameBytes);
    texture.content_type = Text(attributes, "contenttype").substr(0, kMaxNameBytes);
    const std::string u = Text(attributes, "tilestyleu"), v = Text(attributes, "tilestylev");
    texture.clamp_u = u == "clamp" || u == "none";
    texture.clamp_v = v == "clamp" || v == "none";
    texture.mirror_u = u == "mirror";
    texture.mirror_v = v == "mirror";
    texture.nearest = Text(attributes, "filter") == "nearest";
    return absl::OkStatus();
  }

  static constexpr uint64_t kBytesAResource = 1024;  // with its names and its place in a map
  static constexpr size_t kMaxNameBytes = 256, kMaxIgnored = 32;

  LoadBudget& budget_;
  WarningList& warnings_;
  XmlEvents xml_;
  ModelPart part_;
  Object* object_ = nullptr;        // the one that is being read
  PropertyGroup* group_ = nullptr;  // likewise
  uint64_t mesh_begin_ = 0;         // the first vertex of the mesh that is being read
  std::vector<std::string> ignored_;
  uint64_t vertices_ = 0, triangles_ = 0;
  bool is_model_ = false, warned_of_colors_ = false;
};

}  // namespace

absl::StatusOr<ModelPart> ReadModelPart(ZipArchive& archive, const std::string& entry, LoadBudget& budget,
                                        WarningList& warnings) {
  return PartReader(entry, budget, warnings).Read(archive);
}

}  // namespace voxelpipe::threemf
