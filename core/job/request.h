// The voxelization request of the core (without protobuf).
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "grid/grid_spec.h"
#include "grid/voxel_format.h"
#include "raster/coverage.h"

namespace voxelpipe {

enum class Fill : uint8_t {
  kNone,
  kParity,   // even-odd crossings along x through (j+.5, k+.5), on top of the coverage
  kFlood,    // what a 6-connected flood from outside cannot reach without entering the conservative shell
  kNonzero,  // the same crossings, each +1 or -1: inside where those beyond a voxel's centre do not sum to 0
};
// True if the fill casts lines along x, and so reports odd columns.
inline bool CastsLines(Fill fill) {
  return fill == Fill::kParity || fill == Fill::kNonzero;
}

enum class ResultKind : uint8_t {
  kDense,    // every voxel of the grid
  kSparse,   // the occupied 8x8x8 bricks: masks and the values of their occupied voxels
  kBuckets,  // the A-buffer: all fragments of each voxel, by triangle id; blends are ignored, no fill
};

// The sets of triangles that bound a solid of their own (mesh/parts/part_list.h).
enum class PartScope : uint8_t {
  kWhole,     // all triangles together
  kFile,      // each placed mesh
  kNode,      // each instance of a node
  kMesh,      // each mesh of the file, all its instances together
  kMaterial,  // each material
};

// The number of the parts whose name matches: a label or a priority.
struct PartRule {
  std::string pattern;  // * is any bytes, ? one character, all else itself; the whole name, case matters
  int64_t number = 0;
  friend bool operator==(const PartRule&, const PartRule&) = default;
};

struct PartSelection {
  PartScope scope = PartScope::kWhole;
  std::vector<PartRule> labels, priorities;  // of a part the last one that matches; only with a scope but kWhole
  std::vector<std::string> exclude;          // patterns: parts of these names are left out of the mesh
  friend bool operator==(const PartSelection&, const PartSelection&) = default;
};

inline constexpr size_t kMaxPartRules = 1000;  // of each of the three lists

// Instruction set of the CPU backend. All give the same bytes.
enum class SimdChoice : uint8_t { kAuto, kScalar, kAvx2, kAvx512 };

enum class BackendChoice : uint8_t { kAuto, kCpu, kCuda };

// A shader by name with its parameters; each value is a list of numbers (one for a scalar, 16 row-major for a matrix).
// shaders/catalog.h has names, types and defaults, and checks them.
struct ShaderCall {
  std::string name;
  std::map<std::string, std::vector<double>> parameters;
  std::map<std::string, std::string> text{};  // parameters of type "string"
  friend bool operator==(const ShaderCall&, const ShaderCall&) = default;
};

struct TargetSpec {
  VoxelFormat format = VoxelFormat::kBit;
  int components = 1;  // 1-4; kBit takes 1. If users give none: OwnComponents (shaders/catalog.h)
  Blend blend = Blend::kOr;
  ShaderCall shader{"occupancy", {}};
  double quantum = 1.0 / (1 << 20);  // kAdd and kAverage on floats: a power of two
  // f32 shader output into integers: value * scale, nearest even, saturated. Absent: 1; 255 for colour shaders into u8,
  // 65535 into u16. Not for bit and float formats.
  std::optional<double> scale = std::nullopt;
  double clear = 0;  // value of voxels with neither fragment nor fill, every component
  // Value of voxels that are filled and not covered: one number for every component, or one a component. None: the
  // output of the shader without a triangle (shaders/fill_value.h).
  std::vector<double> fill_values{};
  Encoding encoding = Encoding::kLinear;
};

struct VoxelizeRequest {
  GridRequest grid;
  Coverage coverage = Coverage::kConservative;
  Fill fill = Fill::kNone;
  PartSelection parts;
  ShaderCall vertex_shader{"identity", {}};
  std::vector<TargetSpec> targets{TargetSpec{}};  // 1 to kMaxTargets
  Layout layout = Layout::kInterleaved;
  ResultKind result = ResultKind::kDense;
  BackendChoice backend = BackendChoice::kAuto;
  int threads = 0;  // CPU backend; 0 = all cores
  SimdChoice simd = SimdChoice::kAuto;
  bool strict = false;  // the first warning is an error: INVALID_ARGUMENT with its text
};

inline constexpr int kMaxTargets = 8;

// True if each part is filled by itself.
inline bool FillsParts(const VoxelizeRequest& request) {
  return request.parts.scope != PartScope::kWhole && CastsLines(request.fill);
}

std::string_view Name(Coverage coverage);
std::string_view Name(Fill fill);
std::string_view Name(PartScope scope);
std::string_view Name(ResultKind kind);
std::string_view Name(SimdChoice simd);
std::string_view Name(BackendChoice backend);

}  // namespace voxelpipe
