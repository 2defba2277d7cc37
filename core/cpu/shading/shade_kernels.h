// Operations on batches of fragments, by instruction set. The scalar functions of raster/ and shaders/ are the
// definition: vectors repeat them operation by operation.
#pragma once

#include <cstdint>
#include <string_view>

#include "cpu/shading/fragment_batch.h"
#include "grid/formats.h"
#include "shaders/interface/shader_params.h"
#include "shaders/shader_list.h"

namespace voxelpipe::cpu {

// How a target keeps fragments (shaders/blend_ops.h).
struct ConversionRules {
  VoxelFormat format{};  // KeptFormat
  bool is_u32 = false;   // the type of the shader's output
  int components = 1;
  double scale = 1;    // of f32 outputs into integers
  double quantum = 1;  // of sums
};

// Of each component the numbers of all fragments, aligned for vectors.
template <typename Number>
struct alignas(64) BatchOf {
  Number numbers[4][kBatchFragments];
  Number* operator[](int component) { return numbers[component]; }
  const Number* operator[](int component) const { return numbers[component]; }
};
using BatchCells = BatchOf<uint32_t>;
using BatchTerms = BatchOf<int64_t>;

struct ShadeKernels {
  // Sets `degenerate` of the batch's triangles and `barycentric` of its fragments: SetUpPlane and Barycentrics. In: a
  // complete batch.
  void (*place)(FragmentBatch& batch);
  // ShadeFragment of each fragment. False, without output, if there are no vectors for this shader and mesh.
  bool (*shade)(FragmentShaderId shader, const FragmentBatch& batch, const ShaderParams& params, ShadedBatch& out);
  // ToCell, and ToTerm, of the first `count` fragments.
  void (*to_cells)(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchCells& cells);
  void (*to_terms)(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchTerms& terms);
};

// The vertices of meshes up to this many are addressed by 32-bit lanes; larger ones take the scalar kernels.
inline constexpr uint64_t kMaxLaneVertices = uint64_t{1} << 28;

// Of the instruction set with this name (RowKernels::name).
const ShadeKernels& ShadeKernelsNamed(std::string_view name);

// ShadeKernels::shade in plain C++, for every shader.
void ShadeOneByOne(FragmentShaderId shader, const FragmentBatch& batch, const ShaderParams& params, ShadedBatch& out);
// The output of fragment i.
FragmentOutput OutputOf(const ShadedBatch& shaded, bool is_u32, int i);
// The conversions in plain C++.
void ToCellsOneByOne(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchCells& cells);
void ToTermsOneByOne(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchTerms& terms);

}  // namespace voxelpipe::cpu
