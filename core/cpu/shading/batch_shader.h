// Fragment shaders on batches.
#pragma once

#include "cpu/shading/fragment_batch.h"
#include "cpu/shading/shade_kernels.h"
#include "shaders/interface/shader_params.h"
#include "shaders/shader_list.h"

namespace voxelpipe::cpu {

// A shader with its parameters, ready to shade batches. Thread-safe.
class BatchShader {
 public:
  virtual ~BatchShader() = default;
  // In: a complete batch; its barycentrics are set if the shader's traits ask for them, `degenerate` if they ask for
  // the plane. Out: the values of its fragments.
  virtual void Shade(const FragmentBatch& batch, ShadedBatch& out) const = 0;
};

// A shader of shader_list.h: on vectors where `kernels` have it, else ShadeFragment for one fragment after the other.
class BuiltInShader final : public BatchShader {
 public:
  BuiltInShader(const ShadeKernels& kernels, FragmentShaderId id, const ShaderParams& params)
      : kernels_(kernels), id_(id), params_(params) {}

  void Shade(const FragmentBatch& batch, ShadedBatch& out) const override {
    if (!kernels_.shade(id_, batch, params_, out)) ShadeOneByOne(id_, batch, params_, out);
  }

 private:
  const ShadeKernels& kernels_;
  const FragmentShaderId id_;
  const ShaderParams& params_;
};

}  // namespace voxelpipe::cpu
