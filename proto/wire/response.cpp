#include "wire/response.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "base/text.h"
#include "mesh/parts/part_list.h"
#include "wire/count.h"
#include "wire/duration.h"
#include "wire/request.h"

namespace voxelpipe {
namespace {

void WriteVec(const Vec3d& v, v1::Vec3* out) {
  out->set_x(v.x);
  out->set_y(v.y);
  out->set_z(v.z);
}

Vec3d ReadVec(const v1::Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

absl::Status Broken(const std::string& what) {
  return absl::DataLossError(absl::StrCat("the server's answer: ", what));
}

v1::ElementType ToMessage(ElementType type) {
  switch (type) {
    case ElementType::kBit: return v1::ELEMENT_TYPE_BIT;
    case ElementType::kU8: return v1::ELEMENT_TYPE_U8;
    case ElementType::kU16: return v1::ELEMENT_TYPE_U16;
    case ElementType::kU32: return v1::ELEMENT_TYPE_U32;
    case ElementType::kU64: return v1::ELEMENT_TYPE_U64;
    case ElementType::kF16: return v1::ELEMENT_TYPE_F16;
    case ElementType::kF32: return v1::ELEMENT_TYPE_F32;
    case ElementType::kI32: return v1::ELEMENT_TYPE_I32;
  }
  return v1::ELEMENT_TYPE_UNSPECIFIED;
}

// What the catalog calls them.
constexpr std::pair<v1::ShaderParameterType, std::string_view> kParameterTypes[] = {
    {v1::SHADER_PARAMETER_TYPE_FLOAT, "float"},  {v1::SHADER_PARAMETER_TYPE_FLOATS, "floats"},
    {v1::SHADER_PARAMETER_TYPE_VEC3, "vec3"},    {v1::SHADER_PARAMETER_TYPE_VEC4, "vec4"},
    {v1::SHADER_PARAMETER_TYPE_MAT4, "mat4"},    {v1::SHADER_PARAMETER_TYPE_UINT, "uint"},
    {v1::SHADER_PARAMETER_TYPE_STRING, "string"}};
constexpr std::pair<v1::ElementType, std::string_view> kOutputTypes[] = {
    {v1::ELEMENT_TYPE_UNSPECIFIED, "position"}, {v1::ELEMENT_TYPE_F32, "f32"}, {v1::ELEMENT_TYPE_U32, "u32"}};

template <typename Enum, size_t N>
Enum Named(const std::pair<Enum, std::string_view> (&names)[N], std::string_view name) {
  for (const auto& [value, known] : names) {
    if (known == name) return value;
  }
  return Enum(0);
}

template <typename Enum, size_t N>
std::string NameOf(const std::pair<Enum, std::string_view> (&names)[N], Enum value) {
  for (const auto& [known, name] : names) {
    if (known == value) return std::string(name);
  }
  return "unknown";
}

// The counts of the lists of a sparse or bucketed result.
struct Counts {
  uint64_t bricks = 0, voxels = 0, fragments = 0;
};

// Above the fragments of any mesh, and small enough that no product with components and element sizes overflows.
constexpr uint64_t kMaxFragments = uint64_t{1} << 53;
// Of all parts: 4 KiB each.
constexpr int64_t kMaxNameBytes = int64_t{kMaxParts} << 12;

// Reads the counts from the shapes of the first arrays. Rejects counts that the grid cannot hold.
absl::StatusOr<Counts> ReadCounts(const v1::ResultHeader& message, const VoxelizeRequest& request,
                                  const GridSpec& grid) {
  Counts counts;
  if (request.result == ResultKind::kDense) return counts;
  const int lists = request.result == ResultKind::kSparse ? 2 : 3;
  if (message.arrays_size() <= lists) return Broken("fewer arrays than were asked for");
  for (int i = 0; i <= lists; ++i) {
    if (message.arrays(i).shape().empty()) return Broken("an array without a shape");
    for (const int64_t size : message.arrays(i).shape()) {
      if (size < 0) return Broken("an array with a negative size");
    }
  }
  if (request.result == ResultKind::kSparse) {
    counts.bricks = uint64_t(message.arrays(0).shape(0));
    // The count of values is the first dimension; after the components in a planar layout of several components.
    const bool planes = request.layout == Layout::kPlanar && request.targets[0].components > 1;
    const auto& shape = message.arrays(lists).shape();
    counts.voxels = uint64_t(planes ? shape[shape.size() - 1] : shape[0]);
    uint64_t all = 1;
    for (const int64_t dim : grid.dims) all *= uint64_t(dim / 8 + (dim % 8 != 0));
    if (counts.bricks > all) return Broken(absl::StrCat(counts.bricks, " bricks in a grid of ", all));
    if (counts.voxels < counts.bricks || counts.voxels > counts.bricks * 512) {
      return Broken(absl::StrCat(counts.voxels, " voxels in ", counts.bricks, " bricks"));
    }
  } else {
    counts.voxels = uint64_t(message.arrays(0).shape(0));
    counts.fragments = uint64_t(message.arrays(2).shape(0));
    if (counts.fragments < counts.voxels || counts.fragments > kMaxFragments) {
      return Broken(absl::StrCat(counts.fragments, " fragments in ", counts.voxels, " voxels"));
    }
  }
  if (counts.voxels > grid.voxels()) {
    return Broken(absl::StrCat(counts.voxels, " voxels listed in a grid of ", grid.voxels()));
  }
  return counts;
}

// Reads the sizes of the arrays of parts, which follow the first `others` arrays. Where the request cuts the mesh into
// parts they may be absent: it has none.
absl::StatusOr<PartShape> ReadParts(const v1::ResultHeader& message, const VoxelizeRequest& request, size_t others) {
  if (request.parts.scope == PartScope::kWhole || size_t(message.arrays_size()) <= others) return PartShape();
  const v1::ResultArray &first = message.arrays(int(others)), &last = message.arrays(message.arrays_size() - 1);
  if (first.shape().empty() || last.shape().empty()) return Broken("an array without a shape");
  const int64_t parts = first.shape(0), bytes = last.shape(0);
  if (parts < 1 || parts > int64_t(kMaxParts)) return Broken(absl::StrCat(parts, " parts"));
  if (bytes < 0 || bytes > kMaxNameBytes) return Broken(absl::StrCat(bytes, " bytes of names of parts"));
  return PartShape{uint64_t(parts), FillsParts(request), uint64_t(bytes)};
}

}  // namespace

void WriteTo(const GridSpec& grid, v1::Grid& message) {
  message.mutable_dims()->set_x(grid.dims[0]);
  message.mutable_dims()->set_y(grid.dims[1]);
  message.mutable_dims()->set_z(grid.dims[2]);
  WriteVec(grid.origin, message.mutable_origin());
  WriteVec(grid.voxel_size, message.mutable_voxel_size());
  const Mat4d matrix = grid.index_to_world();
  message.mutable_index_to_world()->Reserve(16);
  for (const auto& row : matrix.m) {
    for (const double value : row) message.add_index_to_world(value);
  }
}

v1::Grid ToMessage(const GridSpec& grid) {
  v1::Grid message;
  WriteTo(grid, message);
  return message;
}

absl::StatusOr<GridSpec> FromMessage(const v1::Grid& message) {
  GridSpec grid;
  grid.dims = {message.dims().x(), message.dims().y(), message.dims().z()};
  grid.origin = ReadVec(message.origin());
  grid.voxel_size = ReadVec(message.voxel_size());
  uint64_t voxels = 1;
  for (int a = 0; a < 3; ++a) {
    if (grid.dims[size_t(a)] < 1 || grid.dims[size_t(a)] > kMaxGridDim) {
      return Broken(absl::StrCat("a grid with ", grid.dims[size_t(a)], " voxels along axis ", a));
    }
    voxels *= uint64_t(grid.dims[size_t(a)]);  // 2^60 at most
    if (!(grid.voxel_size[a] > 0) || !std::isfinite(grid.voxel_size[a]) || !std::isfinite(grid.origin[a])) {
      return Broken("a grid whose voxel size is not positive or whose origin is not finite");
    }
  }
  if (voxels > uint64_t{1} << 53) return Broken("a grid beyond 2^53 voxels");
  return grid;
}

void WriteTo(const Plan& plan, v1::VoxelizationPlan& message) {
  WriteTo(plan.grid, *message.mutable_grid());
  message.set_result_bytes(int64_t(plan.result_bytes));
  message.set_peak_bytes(int64_t(plan.peak_bytes));
  message.set_backend(BackendNamed(plan.backend));
  message.set_slab_depth(plan.slab_depth);
  switch (plan.time_class) {
    case TimeClass::kInstant: message.set_time_class(v1::TIME_CLASS_INSTANT); break;
    case TimeClass::kShort: message.set_time_class(v1::TIME_CLASS_SHORT); break;
    case TimeClass::kLong: message.set_time_class(v1::TIME_CLASS_LONG); break;
  }
}

v1::VoxelizationPlan ToMessage(const Plan& plan) {
  v1::VoxelizationPlan message;
  WriteTo(plan, message);
  return message;
}

absl::StatusOr<Plan> FromMessage(const v1::VoxelizationPlan& message) {
  const absl::StatusOr<GridSpec> grid = FromMessage(message.grid());
  if (!grid.ok()) return grid.status();
  Plan plan;
  plan.grid = *grid;
  plan.result_bytes = CountOf(message.result_bytes());
  plan.peak_bytes = CountOf(message.peak_bytes());
  plan.backend = std::string(NameOf(message.backend()));
  plan.slab_depth = message.slab_depth();
  plan.time_class = message.time_class() == v1::TIME_CLASS_INSTANT ? TimeClass::kInstant
                    : message.time_class() == v1::TIME_CLASS_SHORT ? TimeClass::kShort
                                                                   : TimeClass::kLong;
  return plan;
}

void WriteTo(const VoxelizeStats& stats, v1::VoxelizeStats& message) {
  message.set_triangles(int64_t(stats.triangles));
  message.set_triangles_outside(int64_t(stats.triangles_outside));
  if (stats.fragments) message.set_fragments(int64_t(*stats.fragments));
  message.set_occupied(int64_t(stats.occupied));
  if (stats.odd_columns) message.set_odd_columns(int64_t(*stats.odd_columns));
  message.set_backend(BackendNamed(stats.backend));
  message.set_simd(SimdNamed(stats.simd));
  for (const std::string& path : stats.path) *message.add_path() = path;
  for (const auto& [stage, ms] : stats.stages) {
    v1::StageTime* time = message.add_stages();
    time->set_stage(stage);
    WriteMs(ms, *time->mutable_time());
  }
  WriteMs(stats.voxelize_ms, *message.mutable_voxelize_time());
  WriteMs(stats.voxelize_cpu_ms, *message.mutable_voxelize_cpu_time());
}

v1::VoxelizeStats ToMessage(const VoxelizeStats& stats) {
  v1::VoxelizeStats message;
  WriteTo(stats, message);
  return message;
}

VoxelizeStats FromMessage(const v1::VoxelizeStats& message) {
  VoxelizeStats stats;
  stats.triangles = CountOf(message.triangles());
  stats.triangles_outside = CountOf(message.triangles_outside());
  if (message.has_fragments()) stats.fragments = CountOf(message.fragments());
  stats.occupied = CountOf(message.occupied());
  if (message.has_odd_columns()) stats.odd_columns = CountOf(message.odd_columns());
  stats.backend = std::string(NameOf(message.backend()));
  // A GPU has no instruction set of row kernels.
  stats.simd = message.backend() == v1::BACKEND_CUDA ? stats.backend : std::string(NameOf(message.simd()));
  stats.path.assign(message.path().begin(), message.path().end());
  for (const v1::StageTime& time : message.stages()) stats.stages.emplace_back(time.stage(), MsOf(time.time()));
  stats.voxelize_ms = MsOf(message.voxelize_time());
  stats.voxelize_cpu_ms = MsOf(message.voxelize_cpu_time());
  return stats;
}

void WriteTo(const MeshReport& report, bool examined, v1::MeshReport& message) {
  message.set_triangles(int64_t(report.triangles));
  message.set_vertices(int64_t(report.vertices));
  if (examined) {
    message.set_degenerate_triangles(int64_t(report.degenerate_triangles));
    message.set_open_edges(int64_t(report.open_edges));
  }
  WriteVec(report.min, message.mutable_min());
  WriteVec(report.max, message.mutable_max());
}

v1::MeshReport ToMessage(const MeshReport& report, bool examined) {
  v1::MeshReport message;
  WriteTo(report, examined, message);
  return message;
}

void WriteTo(const Warning& warning, v1::Warning& message) {
  // Numbers are those of the enum plus 1: 0 is UNSPECIFIED.
  static_assert(int(WarningCode::kPartOpen) + 1 == v1::WARNING_CODE_PART_OPEN &&
                int(v1::WarningCode_MAX) == v1::WARNING_CODE_PART_OPEN);
  message.set_code(v1::WarningCode(int(warning.code) + 1));
  message.set_place(CleanText(warning.place, WarningList::kMaxTextBytes));
  message.set_text(CleanText(warning.text, WarningList::kMaxTextBytes));
}

Warning FromMessage(const v1::Warning& message) {
  const bool known = message.code() > v1::WARNING_CODE_UNSPECIFIED && v1::WarningCode_IsValid(int(message.code()));
  return {known ? WarningCode(int(message.code()) - 1) : WarningCode::kNonconformingFile, message.place(),
          message.text()};
}

MeshReport FromMessage(const v1::MeshReport& message) {
  MeshReport report;
  report.triangles = CountOf(message.triangles());
  report.vertices = CountOf(message.vertices());
  report.degenerate_triangles = CountOf(message.degenerate_triangles());
  report.open_edges = CountOf(message.open_edges());
  report.min = ReadVec(message.min());
  report.max = ReadVec(message.max());
  return report;
}

v1::ShaderInfo ToMessage(const ShaderInfo& info) {
  v1::ShaderInfo message;
  message.set_name(info.name);
  message.set_stage(info.stage == ShaderStage::kVertex ? v1::SHADER_STAGE_VERTEX : v1::SHADER_STAGE_FRAGMENT);
  message.set_description(info.description);
  message.set_output_type(Named(kOutputTypes, info.output_type));
  message.set_output_components(info.output_components);
  message.set_reads_textures(info.reads_textures);
  for (const ShaderParameterInfo& parameter : info.parameters) {
    v1::ShaderParameterInfo* out = message.add_parameters();
    out->set_name(parameter.name);
    out->set_type(Named(kParameterTypes, parameter.type));
    out->mutable_default_values()->Add(parameter.default_value.begin(), parameter.default_value.end());
    out->set_description(parameter.description);
  }
  return message;
}

ShaderInfo FromMessage(const v1::ShaderInfo& message) {
  ShaderInfo info;
  info.name = message.name();
  info.stage = message.stage() == v1::SHADER_STAGE_VERTEX ? ShaderStage::kVertex : ShaderStage::kFragment;
  info.description = message.description();
  info.output_type = NameOf(kOutputTypes, message.output_type());
  info.output_components = message.output_components();
  info.reads_textures = message.reads_textures();
  for (const v1::ShaderParameterInfo& parameter : message.parameters()) {
    info.parameters.push_back({parameter.name(),
                               NameOf(kParameterTypes, parameter.type()),
                               {parameter.default_values().begin(), parameter.default_values().end()},
                               parameter.description()});
  }
  return info;
}

void WriteTo(const ResultHeader& header, const VoxelizeRequest& request, v1::ResultHeader& message) {
  WriteTo(header.grid, *message.mutable_grid());
  WriteTo(request, *message.mutable_spec());
  for (size_t i = 0; i < request.targets.size(); ++i) {
    const TargetSpec& target = request.targets[i];
    if (target.scale || target.encoding != Encoding::kLinear) continue;
    const ShaderInfo* const shader = FindShader(ShaderStage::kFragment, target.shader.name);
    const double scale = shader == nullptr ? 1 : OwnScale(target.format, *shader);
    if (scale != 1) message.mutable_spec()->mutable_targets(int(i))->set_scale(scale);
  }
  for (const ArraySpec& array : header.arrays) {
    v1::ResultArray* out = message.add_arrays();
    out->set_name(array.name);
    out->set_element_type(ToMessage(array.type));
    out->mutable_shape()->Add(array.shape.begin(), array.shape.end());
  }
}

v1::ResultHeader ToMessage(const ResultHeader& header, const VoxelizeRequest& request) {
  v1::ResultHeader message;
  WriteTo(header, request, message);
  return message;
}

absl::StatusOr<ResultHeader> FromMessage(const v1::ResultHeader& message, const VoxelizeRequest& request) {
  const absl::StatusOr<GridSpec> grid = FromMessage(message.grid());
  if (!grid.ok()) return grid.status();
  if (message.spec().layout() != ToMessage(request.layout)) return Broken("a layout that was not asked for");
  if (message.spec().result() != ToMessage(request.result)) return Broken("a kind of result that was not asked for");
  const absl::StatusOr<Counts> counts = ReadCounts(message, request, *grid);
  if (!counts.ok()) return counts.status();
  ResultHeader header = MakeResultHeader(request, *grid, counts->bricks, counts->voxels, counts->fragments);
  const absl::StatusOr<PartShape> parts = ReadParts(message, request, header.arrays.size());
  if (!parts.ok()) return parts.status();
  header = MakeResultHeader(request, *grid, counts->bricks, counts->voxels, counts->fragments, *parts);
  if (size_t(message.arrays_size()) != header.arrays.size()) {
    return Broken(absl::StrCat(message.arrays_size(), " arrays instead of ", header.arrays.size()));
  }
  for (size_t i = 0; i < header.arrays.size(); ++i) {
    const v1::ResultArray& array = message.arrays(int(i));
    const ArraySpec& expected = header.arrays[i];
    if (array.name() != expected.name) return Broken(absl::StrCat("array ", i, " is not '", expected.name, "'"));
    if (array.element_type() != ToMessage(expected.type)) {
      return Broken(absl::StrCat(expected.name, " has an element type that was not asked for"));
    }
    if (!std::equal(array.shape().begin(), array.shape().end(), expected.shape.begin(), expected.shape.end())) {
      return Broken(absl::StrCat(expected.name, " has shape (", absl::StrJoin(array.shape(), ", "), ") instead of (",
                                 absl::StrJoin(expected.shape, ", "), ")"));
    }
  }
  return header;
}

}  // namespace voxelpipe
