// Texts of help: no trailing full stop; the command line breaks the lines.
#include "request_text/request_options.h"

namespace voxelpipe {

std::span<const RequestOption> ListRequestOptions() {
  using O = RequestOptions;
  using enum OptionGroup;
  static const RequestOption kOptions[] = {
      {"resolution", &O::resolution, kGrid, "N", "Voxels along the longest extent (default 128)"},
      {"voxel_size", &O::voxel_size, kGrid, "H[,HY,HZ]", "Voxel size, one for all axes or three, in the mesh's units"},
      {"dims", &O::dims, kGrid, "X,Y,Z",
       "Voxels along each axis. Alone: the mesh is centred in them, in cubic voxels. With --origin and --voxel-size: "
       "the grid itself"},
      {"origin", &O::origin, kGrid, "X,Y,Z", "Origin of that grid: the corner of its first voxel"},
      {"grid_like", &O::grid_like, kGrid, "FILE",
       "The grid of an earlier result: an OUT.raw.json, a summary of --json, or an .npz of this program"},
      {"axes", &O::axes, kGrid, "A,B,C",
       "The mesh's axes that become the grid's, after the vertex shader: x,z,-y turns a mesh with z up. With identity "
       "and transform"},
      {"clip", &O::clip, kGrid, "X0,Y0,Z0,X1,Y1,Z1",
       "The grid covers this box in place of the mesh's, by --resolution along its longest edge or by --voxel-size; "
       "what lies outside is cut off"},
      {"fit", &O::fit, kGrid, "tight|cube",
       "With --resolution: tight (default): as many voxels an axis as the mesh needs; cube: N x N x N, shorter axes "
       "centred"},
      {"padding", &O::padding, kGrid, "P", "Empty voxels on every side (default 0)"},
      {"coverage", &O::coverage, kValues, "conservative|thin|center|none",
       "Which voxels a triangle covers (default conservative: all it touches; none: with --fill parity or nonzero, "
       "which then fills exactly the voxels whose centre is inside)"},
      {"fill", &O::fill, kValues, "none|parity|nonzero|flood",
       "How the inside is filled (default none): parity by crossings along x, nonzero by their signs, so that parts "
       "may overlap, flood by what a flood from outside does not reach"},
      {"parts", &O::parts, kValues, "whole|file|node|mesh|material",
       "Sets of triangles that bound a solid of their own (default whole: all together): the meshes of --together, "
       "node instances, meshes or materials of the file. Shader label gives a part's label, by default its number from "
       "1"},
      {"part_label", &O::part_labels, kValues, "PATTERN=N",
       "The label of the parts of that name, at least 1; may be given several times, the last that matches holds. In a "
       "pattern * is any text and ? one character"},
      {"part_priority", &O::part_priorities, kValues, "PATTERN=N",
       "The priority of the parts of that name (default 0): where solids overlap the highest owns a voxel, then the "
       "last"},
      {"exclude", &O::exclude, kValues, "PATTERN", "Leave the parts of that name out; may be given several times"},
      {"shader", &O::shader, kValues, "NAME[(TEXT)][:k=v,...]",
       "The fragment shader of every target without one. A vector's numbers are separated by '/', as in "
       "constant:value=0.5/0.2/1; attribute(_HEAT) is attribute:name=_HEAT. 'voxelpipe shaders' lists them"},
      {"vertex_shader", &O::vertex_shader, kValues, "NAME[:k=v,...]", "The vertex shader (default identity)"},
      {"target", &O::targets, kValues, "[SHADER][:FORMAT[xC]][:BLEND][:k=v,...]",
       "A render target, such as normal:f32 or base_color:srgb8; may be given several times. SHADER: default that of "
       "--shader. FORMAT: bit, u8, u16, u32, f16, f32 or srgb8 (u8 in sRGB; default bit for occupancy, else f32), C = "
       "1 to 4 components, by default those of the shader (1 for bit and count). BLEND: or, and, replace, first, count "
       "for bit (default or); also min, max, add, average for integers; for floats all but 'or' and 'and' (default "
       "replace). "
       "k is clear, fill (V or one a component, A/B/C; default: the shader's value without a triangle, else clear), "
       "scale (integers), quantum (add and average of floats), encoding (linear; srgb for colours in u8; snorm for "
       "normals and tangents in u8 and u16), shader, or a parameter of the shader. Default: occupancy:bit:or; with "
       "another --shader its values as f32"},
      {"layout", &O::layout, kValues, "interleaved|planar", "Order of components (default interleaved)"},
      {"result", &O::result, kExecution, "dense|sparse|buckets",
       "Kind of result (default dense): every voxel; the occupied bricks; or all fragments of each voxel"},
      {"backend", &O::backend, kExecution, "auto|cpu|cuda", "Backend that runs the request (default auto)"},
      {"threads", &O::threads, kExecution, "N", "Threads of the CPU backend in this process (default 0: all cores)"},
      {"simd", &O::simd, kExecution, "auto|avx512|avx2|scalar", "Instruction set of the CPU backend (default auto)"},
      {"strict", &O::strict, kExecution, "", "Fail at the first warning"},
  };
  return kOptions;
}

}  // namespace voxelpipe
