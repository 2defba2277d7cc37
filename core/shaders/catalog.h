// The registry of vertex and fragment shaders: names, parameters, outputs, and binding of a ShaderCall.
#pragma once

#include <cmath>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "job/request.h"
#include "mesh/scene/material.h"
#include "shaders/interface/shader_params.h"

namespace voxelpipe {

enum class ShaderStage : uint8_t { kVertex, kFragment };

struct ShaderParameterInfo {
  std::string name;
  std::string type;                   // "float", "vec3", "vec4", "mat4", "uint", "string", "floats" (a list)
  std::vector<double> default_value;  // empty: absent unless given, and read by the host alone
  std::string description;
  // Inclusive range of each number; a "uint" must be a whole number as well.
  double least = -HUGE_VAL, most = HUGE_VAL;
};

struct ShaderInfo {
  std::string name;
  ShaderStage stage = ShaderStage::kFragment;
  std::string description;
  std::string output_type;    // fragment: "f32" or "u32"; vertex: "position"
  int output_components = 0;  // fragment: 1-4
  // Of fragment shaders (FragmentShaderTraits).
  bool reads_textures = false;
  bool can_discard = false;  // may drop fragments, so that a target keeps its own presence bits
  bool is_color = false;     // integer targets scale it to their range by default
  bool is_fraction = false;  // gives fractions: integers without a scale keep whole numbers
  std::vector<ShaderParameterInfo> parameters{};
};

// Every built-in shader, vertex shaders first, in the order of shader_list.h.
std::span<const ShaderInfo> ListShaders();

// The shader of this name, or nullptr.
const ShaderInfo* FindShader(ShaderStage stage, std::string_view name);

// True if the fragment shader's values are directions, which Encoding::kSnorm stores.
bool TakesSnorm(std::string_view shader);

// A shader with checked parameters in the form that shader code reads.
struct BoundShader {
  int id = 0;  // enumerator of FragmentShaderId or VertexShaderId
  const ShaderInfo* info = nullptr;
  ShaderParams params;
  // Parameters of type "string"; ResolveShader resolves them into `params`.
  std::map<std::string, std::string> text{};
};

// INVALID_ARGUMENT naming the unknown shader (and listing the known), the unknown parameter, the wrong count of
// numbers, a value that is not finite, or a text parameter that is missing or given as numbers.
absl::StatusOr<BoundShader> BindShader(ShaderStage stage, const ShaderCall& call);

// The components of a target for which the request gives no number: the shader's; 1 for the format bit, the blend
// count, and an unknown shader.
int OwnComponents(const TargetSpec& target);
// The scale of a target of this format for which the request gives none: colours fill the range of 8 and 16 bits.
double OwnScale(VoxelFormat format, const ShaderInfo& shader);

// The textures that the targets' shaders sample: LoadRequest::textures of a mesh that is loaded for this request.
TextureUse TexturesRead(const VoxelizeRequest& request);
// True if they sample any.
bool RequestReadsTextures(const VoxelizeRequest& request);

}  // namespace voxelpipe
