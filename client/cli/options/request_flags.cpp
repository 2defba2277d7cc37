#include "options/request_flags.h"

#include <vector>

#include "absl/strings/str_split.h"

namespace voxelpipe::cli {

// Breaks a description so that it fits beside the option names on a terminal.
std::string Wrapped(const std::string& text) {
  constexpr size_t kColumns = 78;
  std::string wrapped;
  size_t column = 0;
  for (const std::string& word : std::vector<std::string>(absl::StrSplit(text, ' '))) {
    if (column > 0 && column + 1 + word.size() > kColumns) {
      wrapped += '\n';
      column = 0;
    } else if (column > 0) {
      wrapped += ' ';
      ++column;
    }
    wrapped += word;
    column += word.size();
  }
  return wrapped;
}

namespace {

void AddGridOptions(Command& command, RequestOptions& request) {
  const std::string group = "Grid";
  const auto add = [&](const char* name, ValueRef value, const char* type, const char* text) {
    return command.AddOption(name, value, Wrapped(text)).Group(group).Type(type);
  };
  add("--resolution", request.resolution, "N", "Voxels along the longest extent (default 128)");
  add("--voxel-size", request.voxel_size, "H[,HY,HZ]", "Voxel size, one for all axes or three, in the mesh's units");
  add("--dims", request.dims, "X,Y,Z",
      "Voxels along each axis. Alone: the mesh is centred in them, in cubic voxels. With --origin and --voxel-size: "
      "the grid itself");
  add("--origin", request.origin, "X,Y,Z", "Origin of that grid: the corner of its first voxel");
  add("--grid-like", request.grid_like, "FILE",
      "The grid of an earlier result: an OUT.raw.json, a summary of --json, or an .npz of this program");
  add("--axes", request.axes, "A,B,C",
      "The mesh's axes that become the grid's, after the vertex shader: x,z,-y turns a mesh with z up. With identity "
      "and transform");
  add("--clip", request.clip, "X0,Y0,Z0,X1,Y1,Z1",
      "The grid covers this box in place of the mesh's, by --resolution along its longest edge or by --voxel-size; "
      "what lies outside is cut off");
  add("--fit", request.fit, "tight|cube",
      "tight (default): as many voxels an axis as the mesh needs; cube: N x N x N, shorter axes centred");
  add("--padding", request.padding, "P", "Empty voxels on every side (default 0)");
}

void AddShadingOptions(Command& command, RequestOptions& request) {
  const std::string group = "Voxels and values";
  const auto add = [&](const char* name, ValueRef value, const char* type, const char* text) {
    return command.AddOption(name, value, Wrapped(text)).Group(group).Type(type);
  };
  add("--coverage", request.coverage, "conservative|thin|center|none",
      "Which voxels a triangle covers (default conservative: all it touches; none: with --fill parity or nonzero, "
      "which then fills exactly the voxels whose centre is inside)");
  add("--fill", request.fill, "none|parity|nonzero|flood",
      "How the inside is filled (default none): parity by crossings along x, nonzero by their signs, so that parts "
      "may overlap, flood by what a flood from outside does not reach");
  add("--shader", request.shader, "NAME[:k=v,...]",
      "The fragment shader of every target without one. A vector's numbers are separated by '/', as in "
      "constant:value=0.5/0.2/1. 'voxelpipe shaders' lists them");
  add("--vertex-shader", request.vertex_shader, "NAME[:k=v,...]", "The vertex shader (default identity)");
  add("--target", request.targets, "FORMAT[xC]:BLEND[:k=v,...]",
      "A render target; may be given several times. FORMAT bit, u8, u16, u32, f16 or f32, C = 1 to 4 components, by "
      "default those of the shader (1 for bit and count). BLEND "
      "or, and, replace, first, count for bit; also min, max, add, average for integers; all but or, and for floats. k "
      "is shader, scale (integers), quantum (add and average of floats), clear, fill (V or one a component, A/B/C; "
      "default: the shader's value without a triangle, else clear), encoding (linear; srgb for colours in u8; "
      "snorm for normals and tangents in u8 and u16), or a parameter of the shader. "
      "Default: bit:or with shader occupancy; with another --shader f32xC:replace, C the components of the shader")
      .Repeatable();
  add("--layout", request.layout, "interleaved|planar", "Order of components (default interleaved)");
}

void AddExecutionOptions(Command& command, RequestOptions& request) {
  const auto add = [&](const char* name, ValueRef value, const char* type, const char* text) {
    command.AddOption(name, value, Wrapped(text)).Group(kExecutionGroup).Type(type);
  };
  add("--result", request.result, "dense|sparse|buckets",
      "Kind of result (default dense): every voxel; the occupied bricks; or all fragments of each voxel");
  add("--backend", request.backend, "auto|cpu|cuda", "Backend that runs the request (default auto)");
  add("--threads", request.threads, "N", "Threads of the CPU backend in this process (default 0: all cores)");
  add("--simd", request.simd, "auto|avx512|avx2|scalar", "Instruction set of the CPU backend (default auto)");
  command.AddFlag("--strict", request.strict, "Fail at the first warning").Group(kExecutionGroup);
}

}  // namespace

void AddRequestFlags(Command& command, RequestOptions& request) {
  AddGridOptions(command, request);
  AddShadingOptions(command, request);
  AddExecutionOptions(command, request);
}

}  // namespace voxelpipe::cli
