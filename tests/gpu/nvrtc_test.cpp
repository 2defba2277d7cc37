// The kernels' headers hold nothing that only a host compiler knows: NVRTC, which shaders supplied at run time will go
// through, compiles them with a shader of its own. Needs the toolkit's library but no GPU.
#include <nvrtc.h>

#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// Stand-ins for the standard headers that the kernels' headers include; NVRTC has the functions built in.
struct Header {
  const char *name, *text;
};
constexpr Header kHeaders[] = {
    {"cstdint",
     R"(#pragma once
using int8_t = signed char;
using uint8_t = unsigned char;
using int16_t = short;
using uint16_t = unsigned short;
using int32_t = int;
using uint32_t = unsigned;
using int64_t = long;
using uint64_t = unsigned long;
#define INT32_MAX 2147483647
#define INT64_MAX 9223372036854775807l
#define UINT32_MAX 4294967295u
#define UINT64_MAX 18446744073709551615ul
)"},
    {"cmath", "#pragma once\n#define HUGE_VAL __longlong_as_double(0x7ff0000000000000ll)\n"},
    {"cstring", "#pragma once\n"},
    {"array",
     R"(#pragma once
namespace std {
template <typename T, unsigned long kSize>
struct array {
  T elements[kSize];
  constexpr T& operator[](unsigned long i) { return elements[i]; }
  constexpr const T& operator[](unsigned long i) const { return elements[i]; }
};
}
)"},
};

// A fragment shader as an operator might write it.
constexpr const char* kShader = R"(
#define VOXELPIPE_FRAGMENT_SHADERS(X) X(Height)
#include "shaders/interface/fragment.h"
namespace voxelpipe {
struct HeightShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams& params, FragmentOutput& out) {
    const Vec3d* p = in.mesh->positions;
    out.f[0] = Interpolate(in.barycentric, float(p[in.vertex[0]].y), float(p[in.vertex[1]].y),
                           float(p[in.vertex[2]].y)) * float(params.value[0]);
    out.discard = out.f[0] < 0;
  }
};
}
)";

struct Compiled {
  nvrtcResult result;
  std::string log;
  std::vector<char> cubin;
};

Compiled Compile(const std::string& source, const std::vector<const char*>& kernels) {
  std::vector<const char*> names, texts;
  for (const Header& header : kHeaders) {
    names.push_back(header.name);
    texts.push_back(header.text);
  }
  nvrtcProgram program;
  EXPECT_EQ(nvrtcCreateProgram(&program, source.c_str(), "shader.cu", int(names.size()), texts.data(), names.data()),
            NVRTC_SUCCESS);
  for (const char* kernel : kernels) EXPECT_EQ(nvrtcAddNameExpression(program, kernel), NVRTC_SUCCESS);
  // As core's own device code: nothing that would change a byte.
  const std::vector<const char*> options = {"--std=c++20",  "-arch=sm_90",          "-default-device",
                                            "--fmad=false", "--prec-div=true",      "--prec-sqrt=true",
                                            "--ftz=false",  "-I" VOXELPIPE_CORE_DIR};
  Compiled compiled;
  compiled.result = nvrtcCompileProgram(program, int(options.size()), options.data());
  size_t size = 0;
  nvrtcGetProgramLogSize(program, &size);
  compiled.log.resize(size);
  nvrtcGetProgramLog(program, compiled.log.data());
  if (compiled.result == NVRTC_SUCCESS) {
    nvrtcGetCUBINSize(program, &size);
    compiled.cubin.resize(size);
    nvrtcGetCUBIN(program, compiled.cubin.data());
    for (const char* kernel : kernels) {
      const char* lowered = nullptr;
      EXPECT_EQ(nvrtcGetLoweredName(program, kernel, &lowered), NVRTC_SUCCESS) << kernel;
    }
  }
  nvrtcDestroyProgram(&program);
  return compiled;
}

TEST(NvrtcTest, CompilesTheKernelsOfABatchsABuffers) {
  const std::string in = "voxelpipe::cuda::", args = ", " + in + "BatchWalkArgs>";
  const std::vector<std::string> kernels = {in + "WalkRuns<" + in + "CountFragments" + args,
                                            in + "WalkSmall<" + in + "EmitFragment" + args,
                                            in + "WalkRest<" + in + "EmitFragment" + args,
                                            in + "WalkLarge<" + in + "EmitFragment" + args,
                                            in + "EmitRuns",
                                            in + "DropFragments",
                                            in + "FindItems",
                                            in + "ShadeBatchFragments"};
  std::vector<const char*> names;
  for (const std::string& kernel : kernels) names.push_back(kernel.c_str());
  const Compiled compiled = Compile(std::string(kShader) + "#include \"cuda/batch/batch_fragments.cuh\"\n", names);
  EXPECT_EQ(compiled.result, NVRTC_SUCCESS) << compiled.log;
  EXPECT_GT(compiled.cubin.size(), 1000u);
}

TEST(NvrtcTest, CompilesTheKernelsOfABatchsValues) {
  const std::string in = "voxelpipe::cuda::";
  const std::string walk_small = in + "WalkSmall<" + in + "CountAndSetBits, " + in + "BatchWalkArgs>",
                    rank = in + "RankItems", blend = in + "BlendBatchFragments", store = in + "StoreBatchValues";
  const Compiled compiled = Compile(std::string(kShader) + "#include \"cuda/batch/batch_values.cuh\"\n",
                                    {walk_small.c_str(), rank.c_str(), blend.c_str(), store.c_str()});
  EXPECT_EQ(compiled.result, NVRTC_SUCCESS) << compiled.log;
  EXPECT_GT(compiled.cubin.size(), 1000u);
}

TEST(NvrtcTest, CompilesTheKernelsOfABatchsFloodFill) {
  const std::string in = "voxelpipe::cuda::";
  const std::string walk_small = in + "WalkSmall<" + in + "SetBatchBits<&" + in + "BatchItemView::first_shell>, " + in +
                                 "ShellWalkArgs>",
                    flood = in + "FloodKernel";
  const Compiled compiled =
      Compile(std::string(kShader) + "#include \"cuda/batch/batch_flood.cuh\"\n", {walk_small.c_str(), flood.c_str()});
  EXPECT_EQ(compiled.result, NVRTC_SUCCESS) << compiled.log;
  EXPECT_GT(compiled.cubin.size(), 1000u);
}

TEST(NvrtcTest, CompilesTheKernelsThatFindCellsAndBlendAndShadeThem) {
  const std::string in = "voxelpipe::cuda::";
  const std::vector<std::string> kernels = {
      in + "FindCells<false, " + in + "CellSink::kRecords, -1, false>",
      in + "FindCells<true, " + in + "CellSink::kBlend, -1, true>",
      in + "FindCells<false, " + in + "CellSink::kRecordsAndBits, -1, true>",
      in + "EmitRest<" + in + "SpanWriter>",
      in + "EmitRest<" + in + "BlendWriter<-1>>",
      in + "EmitLarge<" + in + "SpanWriter>",
      in + "ShadeTriangles<-1>",
      in + "BlendCells<4, -1, " + in + "BlendTo::kTarget>",
      in + "BlendCells<4, -1, " + in + "BlendTo::kAccumulators>",
      in + "BlendInPlace<1, -1>",
      in + "Accumulate<4, -1>",
      in + "StoreAccumulated",
      in + "ListOwners",
      in + "ShadeCoverage",
      in + "EmitCells",
      in + "EmitRest<" + in + "FragmentWriter>",
      in + "WriteBuckets<false, unsigned>",
      in + "WriteBuckets<true, unsigned long>",
      in + "EmitListed",
      in + "ScanChunks",
  };
  std::vector<const char*> names;
  for (const std::string& kernel : kernels) names.push_back(kernel.c_str());
  const Compiled compiled = Compile(
      std::string(kShader) +
          "#include \"cuda/scatter/atomic_row_sink.cuh\"\n#include \"cuda/a_buffer/resolve_kernels.cuh\"\n#include "
          "\"cuda/scatter/blend_records.cuh\"\n"
          "#include \"cuda/a_buffer/emit_records.cuh\"\n#include \"cuda/shading/coverage_shading.cuh\"\n#include "
          "\"cuda/scatter/store_accumulators.cuh\"\n",
      names);
  EXPECT_EQ(compiled.result, NVRTC_SUCCESS) << compiled.log;
  EXPECT_GT(compiled.cubin.size(), 1000u);
}

TEST(NvrtcTest, CompilesTheKernelsThatBlendByFours) {
  const std::string in = "voxelpipe::cuda::";
  const std::vector<std::string> kernels = {
      in + "BlendFours<true, -1>",
      in + "BlendFours<false, " + in + "kNormalShader>",
      in + "EmitRest<" + in + "BlendWriter<" + in + "kNormalShader, 4>>",
  };
  std::vector<const char*> names;
  for (const std::string& kernel : kernels) names.push_back(kernel.c_str());
  const Compiled compiled =
      Compile(std::string(kShader) +
                  "#include \"cuda/scatter/atomic_row_sink.cuh\"\n#include \"cuda/scatter/float4_pass.cuh\"\n",
              names);
  EXPECT_EQ(compiled.result, NVRTC_SUCCESS) << compiled.log;
  EXPECT_GT(compiled.cubin.size(), 1000u);
}

TEST(NvrtcTest, CompilesTheKernelsOfAPoolOfBricks) {
  const std::string in = "voxelpipe::cuda::";
  const std::vector<std::string> kernels = {
      in + "FindCells<false, " + in + "CellSink::kPool, -1, false>",
      in + "EmitRest<" + in + "PoolWriter<-1>>",
      in + "EmitLarge<" + in + "PoolWriter<-1>>",
      in + "MaskPlaces",
      in + "CountTiles",
      in + "EmitPlaces",
  };
  std::vector<const char*> names;
  for (const std::string& kernel : kernels) names.push_back(kernel.c_str());
  const Compiled compiled =
      Compile(std::string(kShader) +
                  "#include \"cuda/scatter/brick_scatter_kernels.cuh\"\n#include \"cuda/coverage/coverage_pass.cuh\"\n",
              names);
  EXPECT_EQ(compiled.result, NVRTC_SUCCESS) << compiled.log;
  EXPECT_GT(compiled.cubin.size(), 1000u);
}

TEST(NvrtcTest, CompilesTheVertexShadersAndTheMeasureOfTheSurface) {
  const Compiled compiled =
      Compile(std::string(kShader) + "#include \"cuda/vertex/vertex_kernels.cuh\"\n",
              {"voxelpipe::cuda::ShadeVertices<1>", "voxelpipe::cuda::ShadeVertices<4>",
               "voxelpipe::cuda::MeasureTriangles<voxelpipe::cuda::Sums::kInWindow>", "voxelpipe::cuda::JoinSurfaces"});
  EXPECT_EQ(compiled.result, NVRTC_SUCCESS) << compiled.log;
  EXPECT_GT(compiled.cubin.size(), 1000u);
}

TEST(NvrtcTest, RefusesHeadersOfTheHost) {
  EXPECT_NE(Compile("#include <vector>\n#include \"base/vec.h\"\n", {}).result, NVRTC_SUCCESS);
  EXPECT_NE(Compile("#include \"mesh/triangle_mesh.h\"\n", {}).result, NVRTC_SUCCESS);
}

}  // namespace
}  // namespace voxelpipe
