#include "shaders/catalog.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "base/nearest_name.h"
#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

const std::vector<double> kIdentityMatrix = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

using Parameters = std::vector<ShaderParameterInfo>;

// The parameters of a vertex shader: its own, then RigidMotion's.
Parameters WithMotion(Parameters own) {
  own.push_back({"linear_velocity", "vec3", {0, 0, 0}, "added to every vertex's velocity, world units a second"});
  own.push_back({"angular_velocity", "vec3", {0, 0, 0}, "turn about `center`, radians a second, right-handed"});
  own.push_back({"center", "vec3", {0, 0, 0}, "a point of the axis of the turn, world units"});
  return own;
}

// Those of the shaders that pose the mesh. `animation`, `time` and `weights` take no slot: the host evaluates them.
Parameters PoseParameters(Parameters own) {
  own.push_back({"animation", "uint", {}, "index of the file's animation; default 0 with a time", 0, 4294967295.0});
  own.push_back({"time", "float", {}, "seconds, clamped to the animation's; default: the pose of the file"});
  own.push_back({"dt", "float", {0}, "seconds; above 0: velocity = (p(time + dt) - p(time)) / dt", 0});
  return WithMotion(std::move(own));
}

// In the order of shader_list.h; CatalogTest holds the two together.
std::vector<ShaderInfo> Rows() {
  return {
      {.name = "identity",
       .stage = ShaderStage::kVertex,
       .description = "The vertices as they are.",
       .output_type = "position",
       .parameters = WithMotion({})},
      {.name = "transform",
       .stage = ShaderStage::kVertex,
       .description = "Multiplies positions by a matrix, and normals by its inverse transpose.",
       .output_type = "position",
       .parameters =
           WithMotion({{"matrix", "mat4", kIdentityMatrix, "16 numbers, row major, last row 0/0/0/1"},
                       {"matrix_previous", "mat4", kIdentityMatrix, "the matrix dt seconds before, for velocities"},
                       {"dt", "float", {0}, "seconds; above 0: velocity = (matrix p - matrix_previous p) / dt", 0}})},
      {.name = "displace_along_normal",
       .stage = ShaderStage::kVertex,
       .description = "Moves vertices along their unit normals; those without a normal stay.",
       .output_type = "position",
       .parameters = WithMotion({{"distance", "float", {0}, "world units; negative moves inwards"}})},
      {.name = "morph",
       .stage = ShaderStage::kVertex,
       .description = "Morph targets at given weights, or at a time of an animation of the file; nodes stay.",
       .output_type = "position",
       .parameters = PoseParameters({{"weights", "floats", {}, "one a morph target, the rest 0; not with a time"}})},
      {.name = "skin",
       .stage = ShaderStage::kVertex,
       .description = "The file's animated pose at a time: nodes, morph targets and skins.",
       .output_type = "position",
       .parameters = PoseParameters({})},
      {.name = "occupancy",
       .description = "1 for every fragment, and inside of what is filled.",
       .output_type = "f32",
       .output_components = 1},
      {.name = "constant",
       .description = "The same value for every fragment, and inside of what is filled.",
       .output_type = "f32",
       .output_components = 4,
       .parameters = {{"value", "vec4", {1, 0, 0, 1}, "1 to 4 numbers; those not given are 0, the fourth 1"}}},
      {.name = "triangle_id",
       .description = "The triangle's id, from 0 over the flattened scene.",
       .output_type = "u32",
       .output_components = 1},
      {.name = "barycentric",
       .description = "Barycentric coordinates of the voxel's centre projected onto the triangle.",
       .output_type = "f32",
       .output_components = 3},
      {.name = "geometric_normal",
       .description = "Unit normal of the triangle's plane, world axes; 0 for degenerate triangles.",
       .output_type = "f32",
       .output_components = 3},
      {.name = "normal",
       .description = "Interpolated vertex normal, world axes, unit length; geometric where the mesh has none.",
       .output_type = "f32",
       .output_components = 3},
      {.name = "packed_normal",
       .description = "The normal of `normal` on an octahedral map, 8 + 8 bits: (u << 8) | v.",
       .output_type = "u32",
       .output_components = 1},
      {.name = "base_color",
       .description = "Base colour factor x texture x vertex colour, linear RGBA; alpha MASK discards fragments.",
       .output_type = "f32",
       .output_components = 4},
      {.name = "emissive",
       .description = "Emissive factor x strength x texture, linear RGB; alpha MASK discards fragments.",
       .output_type = "f32",
       .output_components = 3},
      {.name = "metallic_roughness",
       .description = "Metallic and roughness, factors x texture; alpha MASK discards fragments.",
       .output_type = "f32",
       .output_components = 2},
      {.name = "material_id",
       .description = "The triangle's glTF material; the default material counts as one after the last.",
       .output_type = "u32",
       .output_components = 1},
      {.name = "mesh_id", .description = "The triangle's glTF mesh.", .output_type = "u32", .output_components = 1},
      {.name = "tangent",
       .description = "Interpolated vertex tangent, world axes, unit length, and handedness; 0/0/0/1 without tangents.",
       .output_type = "f32",
       .output_components = 4},
      {.name = "uv",
       .description = "Texture coordinates as in the file, origin at the top left; 0 where the mesh has none.",
       .output_type = "f32",
       .output_components = 2,
       .parameters = {{"set", "uint", {0}, "0 or 1: TEXCOORD_0 or TEXCOORD_1", 0, 1}}},
      {.name = "color",
       .description = "Vertex colour COLOR_0, linear RGBA; white where the mesh has none.",
       .output_type = "f32",
       .output_components = 4},
      {.name = "attribute",
       .description = "A vertex attribute of the file's own, 1 to 4 components; 0 in parts of the mesh without it.",
       .output_type = "f32",
       .output_components = 4,
       .parameters = {{"name", "string", {}, "the attribute's name, such as _TEMPERATURE"}}},
      {.name = "velocity",
       .description =
           "Velocity that the vertex shader gives, world units a second; 0 where it gives none. Filled voxels have "
           "that of the rigid motion at their centre.",
       .output_type = "f32",
       .output_components = 3},
      {.name = "position",
       .description =
           "The triangle's point at the voxel's barycentric coordinates, world units; the centre of filled voxels.",
       .output_type = "f32",
       .output_components = 3},
      {.name = "coverage_fraction",
       .description = "Area of the triangle inside the voxel over that of a voxel face, in index space.",
       .output_type = "f32",
       .output_components = 1},
      {.name = "checker",
       .description = "A checkerboard of cubes of voxels, beginning with an even one at voxel 0, 0, 0; inside too.",
       .output_type = "f32",
       .output_components = 1,
       .parameters = {{"size", "uint", {8}, "voxels along the edge of a cube", 1, 4294967295.0},
                      {"even", "float", {1}, "value of the even cubes"},
                      {"odd", "float", {0}, "value of the odd cubes"}}},
      {.name = "label",
       .description = "The label of the triangle's part; 1 where the request has no parts.",
       .output_type = "u32",
       .output_components = 1},
  };
}

constexpr int CountVertexShaders() {
#define VOXELPIPE_ONE(name) +1
  return 0 VOXELPIPE_VERTEX_SHADERS(VOXELPIPE_ONE);
#undef VOXELPIPE_ONE
}

const std::vector<ShaderInfo>& Catalog() {
  static const auto* catalog = [] {
    auto* rows = new std::vector<ShaderInfo>(Rows());
    for (size_t i = size_t(CountVertexShaders()); i < rows->size(); ++i) {
      const ShaderTraits traits = TraitsOf(FragmentShaderId(int(i) - CountVertexShaders()));
      (*rows)[i].reads_textures = traits.reads_textures();
      (*rows)[i].can_discard = traits.can_discard;
      (*rows)[i].is_color = traits.is_color;
      (*rows)[i].is_fraction = traits.is_fraction;
    }
    return rows;
  }();
  return *catalog;
}

const char* StageName(ShaderStage stage) {
  return stage == ShaderStage::kVertex ? "vertex" : "fragment";
}

// How many numbers a parameter of this type takes, at least and at most.
std::pair<size_t, size_t> NumbersOf(std::string_view type) {
  if (type == "mat4") return {16, 16};
  if (type == "vec3") return {3, 3};
  if (type == "floats") return {1, 65536};
  if (type == "vec4") return {1, 4};
  return {1, 1};
}

absl::Status FillSlots(const ShaderInfo& info, const ShaderParameterInfo& parameter, const std::vector<double>& given,
                       double* slot) {
  const auto [least, most] = NumbersOf(parameter.type);
  if (given.size() < least || given.size() > most) {
    const std::string wanted = least == most ? absl::StrCat(least) : absl::StrCat(least, " to ", most);
    return absl::InvalidArgumentError(absl::StrCat("shader '", info.name, "': parameter '", parameter.name, "' takes ",
                                                   wanted, " numbers, ", given.size(), " given"));
  }
  for (const double v : given) {
    if (!std::isfinite(v)) {
      return absl::InvalidArgumentError(
          absl::StrCat("shader '", info.name, "': parameter '", parameter.name, "' must be finite"));
    }
    const bool whole = parameter.type != "uint" || std::floor(v) == v;
    if (!whole || v < parameter.least || v > parameter.most) {
      return absl::InvalidArgumentError(absl::StrCat("shader '", info.name, "': parameter '", parameter.name,
                                                     "' must be ", parameter.type == "uint" ? "a whole number " : "",
                                                     "from ", parameter.least, " to ", parameter.most, ", ", v,
                                                     " given"));
    }
  }
  if (parameter.default_value.empty()) return absl::OkStatus();  // read by the host, without a slot
  std::copy(given.begin(), given.end(), slot);
  if (parameter.type == "vec4") {
    for (size_t i = given.size(); i < 4; ++i) slot[i] = i == 3 ? 1.0 : 0.0;
  }
  if (parameter.type == "mat4" && (slot[12] != 0 || slot[13] != 0 || slot[14] != 0 || slot[15] != 1)) {
    return absl::InvalidArgumentError(
        absl::StrCat("shader '", info.name, "': parameter '", parameter.name, "' must have the last row 0, 0, 0, 1"));
  }
  return absl::OkStatus();
}

// " (did you mean 'value'? known: value)"
std::string KnownParameters(const ShaderInfo& info, const std::string& name) {
  std::vector<std::string> known;
  for (const ShaderParameterInfo& parameter : info.parameters) known.push_back(parameter.name);
  if (known.empty()) return "; it takes none";
  const std::string nearest = DidYouMean(name, known);
  return absl::StrCat(" (", nearest, nearest.empty() ? "" : " ", "known: ", absl::StrJoin(known, ", "), ")");
}

const ShaderParameterInfo* FindParameter(const ShaderInfo& info, const std::string& name) {
  const auto& known = info.parameters;
  const auto found = std::find_if(known.begin(), known.end(), [&](const auto& p) { return p.name == name; });
  return found == known.end() ? nullptr : &*found;
}

absl::Status NoParameter(const ShaderInfo& info, const std::string& name) {
  return absl::InvalidArgumentError(
      absl::StrCat("shader '", info.name, "' has no parameter '", name, "'", KnownParameters(info, name)));
}

// The text parameters, every one of which must be given.
absl::Status TakeText(const ShaderCall& call, BoundShader& bound) {
  for (const auto& [name, value] : call.text) {
    const ShaderParameterInfo* const parameter = FindParameter(*bound.info, name);
    if (parameter == nullptr) return NoParameter(*bound.info, name);
    if (parameter->type == "string") continue;
    return absl::InvalidArgumentError(
        absl::StrCat("shader '", call.name, "': parameter '", name, "' takes numbers, '", value, "' given"));
  }
  for (const ShaderParameterInfo& parameter : bound.info->parameters) {
    if (parameter.type != "string") continue;
    const auto given = call.text.find(parameter.name);
    if (given == call.text.end() || given->second.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat("shader '", call.name, "': parameter '", parameter.name, "' must be given as text"));
    }
  }
  bound.text = call.text;
  return absl::OkStatus();
}

}  // namespace

std::span<const ShaderInfo> ListShaders() {
  return Catalog();
}

const ShaderInfo* FindShader(ShaderStage stage, std::string_view name) {
  for (const ShaderInfo& info : Catalog()) {
    if (info.stage == stage && info.name == name) return &info;
  }
  return nullptr;
}

bool TakesSnorm(std::string_view shader) {
  return shader == "normal" || shader == "geometric_normal" || shader == "tangent";
}

absl::StatusOr<BoundShader> BindShader(ShaderStage stage, const ShaderCall& call) {
  BoundShader bound;
  bound.info = FindShader(stage, call.name);
  if (bound.info == nullptr) {
    std::vector<std::string> known;
    for (const ShaderInfo& info : Catalog()) {
      if (info.stage == stage) known.push_back(info.name);
    }
    const std::string nearest = DidYouMean(call.name, known);
    return absl::InvalidArgumentError(absl::StrCat("there is no ", StageName(stage), " shader '", call.name, "' (",
                                                   nearest, nearest.empty() ? "" : " ",
                                                   "known: ", absl::StrJoin(known, ", "), ")"));
  }
  const int index = int(bound.info - Catalog().data());
  bound.id = stage == ShaderStage::kVertex ? index : index - CountVertexShaders();
  double* slot = bound.params.value;
  size_t found = 0;
  for (const ShaderParameterInfo& parameter : bound.info->parameters) {
    if (parameter.type == "string") continue;
    const auto given = call.parameters.find(parameter.name);
    if (given == call.parameters.end()) {
      std::copy(parameter.default_value.begin(), parameter.default_value.end(), slot);
    } else {
      ++found;
      if (absl::Status s = FillSlots(*bound.info, parameter, given->second, slot); !s.ok()) return s;
    }
    slot += parameter.default_value.size();
  }
  if (found != call.parameters.size()) {
    for (const auto& [name, value] : call.parameters) {
      if (FindParameter(*bound.info, name) == nullptr) return NoParameter(*bound.info, name);
    }
  }
  if (absl::Status s = TakeText(call, bound); !s.ok()) return s;
  return bound;
}

int OwnComponents(const TargetSpec& target) {
  if (target.format == VoxelFormat::kBit || target.blend == Blend::kCount) return 1;
  const ShaderInfo* info = FindShader(ShaderStage::kFragment, target.shader.name);
  return info == nullptr ? 1 : info->output_components;
}

double OwnScale(VoxelFormat format, const ShaderInfo& shader) {
  if (!shader.is_color) return 1;
  return format == VoxelFormat::kU8 ? 255 : format == VoxelFormat::kU16 ? 65535 : 1;
}

TextureUse TexturesRead(const VoxelizeRequest& request) {
  ShaderTraits traits;
  for (const TargetSpec& target : request.targets) {
    const ShaderInfo* info = FindShader(ShaderStage::kFragment, target.shader.name);
    if (info != nullptr) traits |= TraitsOf(FragmentShaderId(int(info - Catalog().data()) - CountVertexShaders()));
  }
  return {traits.reads_base_color, traits.reads_emissive, traits.reads_metallic_roughness};
}

bool RequestReadsTextures(const VoxelizeRequest& request) {
  return TexturesRead(request).any();
}

}  // namespace voxelpipe
