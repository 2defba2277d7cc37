#include "wire/request.h"

#include <algorithm>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

absl::Status Invalid(const std::string& field, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat(field, ": ", why));
}

// One row for each pair of enumerators; UNSPECIFIED means the first.
template <typename Message, typename Core>
struct Pair {
  Message message;
  Core core;
};

constexpr Pair<v1::MeshFormat, MeshFormat> kMeshFormats[] = {
    {v1::MESH_FORMAT_UNSPECIFIED, MeshFormat::kAuto}, {v1::MESH_FORMAT_GLB, MeshFormat::kGlb},
    {v1::MESH_FORMAT_GLTF, MeshFormat::kGltf},        {v1::MESH_FORMAT_DRACO, MeshFormat::kDraco},
    {v1::MESH_FORMAT_STL, MeshFormat::kStl},          {v1::MESH_FORMAT_PLY, MeshFormat::kPly},
    {v1::MESH_FORMAT_OFF, MeshFormat::kOff},          {v1::MESH_FORMAT_OBJ, MeshFormat::kObj},
    {v1::MESH_FORMAT_3MF, MeshFormat::k3mf}};
constexpr Pair<v1::LengthUnit, LengthUnit> kUnits[] = {{v1::LENGTH_UNIT_UNSPECIFIED, LengthUnit::kNone},
                                                       {v1::LENGTH_UNIT_MILLIMETRE, LengthUnit::kMillimetre},
                                                       {v1::LENGTH_UNIT_CENTIMETRE, LengthUnit::kCentimetre},
                                                       {v1::LENGTH_UNIT_METRE, LengthUnit::kMetre},
                                                       {v1::LENGTH_UNIT_INCH, LengthUnit::kInch}};
constexpr Pair<v1::GridFit, GridFit> kFits[] = {{v1::GRID_FIT_TIGHT, GridFit::kTight},
                                                {v1::GRID_FIT_CUBE, GridFit::kCube}};
constexpr Pair<v1::Coverage, Coverage> kCoverages[] = {{v1::COVERAGE_CONSERVATIVE, Coverage::kConservative},
                                                       {v1::COVERAGE_THIN, Coverage::kThin},
                                                       {v1::COVERAGE_CENTER, Coverage::kCenter},
                                                       {v1::COVERAGE_NONE, Coverage::kNone}};
constexpr Pair<v1::Fill, Fill> kFills[] = {{v1::FILL_NONE, Fill::kNone},
                                           {v1::FILL_PARITY, Fill::kParity},
                                           {v1::FILL_FLOOD, Fill::kFlood},
                                           {v1::FILL_NONZERO, Fill::kNonzero}};
constexpr Pair<v1::Encoding, Encoding> kEncodings[] = {{v1::ENCODING_LINEAR, Encoding::kLinear},
                                                       {v1::ENCODING_SRGB, Encoding::kSrgb},
                                                       {v1::ENCODING_SNORM, Encoding::kSnorm}};
constexpr Pair<v1::ResultKind, ResultKind> kResults[] = {{v1::RESULT_KIND_DENSE, ResultKind::kDense},
                                                         {v1::RESULT_KIND_SPARSE, ResultKind::kSparse},
                                                         {v1::RESULT_KIND_BUCKETS, ResultKind::kBuckets}};
constexpr Pair<v1::Simd, SimdChoice> kSimds[] = {{v1::SIMD_AUTO, SimdChoice::kAuto},
                                                 {v1::SIMD_SCALAR, SimdChoice::kScalar},
                                                 {v1::SIMD_AVX2, SimdChoice::kAvx2},
                                                 {v1::SIMD_AVX512, SimdChoice::kAvx512}};
constexpr Pair<v1::Compression, Compression> kCompressions[] = {{v1::COMPRESSION_NONE, Compression::kNone},
                                                                {v1::COMPRESSION_ZSTD, Compression::kZstd}};
constexpr Pair<v1::Priority, Priority> kPriorities[] = {
    {v1::PRIORITY_NORMAL, Priority::kNormal}, {v1::PRIORITY_HIGH, Priority::kHigh}, {v1::PRIORITY_LOW, Priority::kLow}};
constexpr Pair<v1::VoxelFormat, VoxelFormat> kFormats[] = {
    {v1::VOXEL_FORMAT_BIT, VoxelFormat::kBit}, {v1::VOXEL_FORMAT_U8, VoxelFormat::kU8},
    {v1::VOXEL_FORMAT_U16, VoxelFormat::kU16}, {v1::VOXEL_FORMAT_U32, VoxelFormat::kU32},
    {v1::VOXEL_FORMAT_F16, VoxelFormat::kF16}, {v1::VOXEL_FORMAT_F32, VoxelFormat::kF32}};
constexpr Pair<v1::Blend, Blend> kBlends[] = {
    {v1::BLEND_OR, Blend::kOr},           {v1::BLEND_REPLACE, Blend::kReplace}, {v1::BLEND_MIN, Blend::kMin},
    {v1::BLEND_MAX, Blend::kMax},         {v1::BLEND_ADD, Blend::kAdd},         {v1::BLEND_FIRST, Blend::kFirst},
    {v1::BLEND_AVERAGE, Blend::kAverage}, {v1::BLEND_COUNT, Blend::kCount},     {v1::BLEND_AND, Blend::kAnd}};
constexpr Pair<v1::Layout, Layout> kLayouts[] = {{v1::LAYOUT_INTERLEAVED, Layout::kInterleaved},
                                                 {v1::LAYOUT_PLANAR, Layout::kPlanar}};
constexpr Pair<v1::Backend, BackendChoice> kBackends[] = {{v1::BACKEND_AUTO, BackendChoice::kAuto},
                                                          {v1::BACKEND_CPU, BackendChoice::kCpu},
                                                          {v1::BACKEND_CUDA, BackendChoice::kCuda}};

// Enum values that this server does not know arrive as plain numbers, from newer clients.
template <typename Message, typename Core, size_t N>
absl::Status ReadEnum(const Pair<Message, Core> (&pairs)[N], Message message, const std::string& field, Core& out) {
  if (int(message) == 0) return out = pairs[0].core, absl::OkStatus();
  for (const auto& pair : pairs) {
    if (pair.message == message) return out = pair.core, absl::OkStatus();
  }
  return Invalid(field, absl::StrCat("this server does not know the value ", int(message)));
}

template <typename Message, typename Core, size_t N>
Message WriteEnum(const Pair<Message, Core> (&pairs)[N], Core core) {
  for (const auto& pair : pairs) {
    if (pair.core == core) return pair.message;
  }
  return pairs[0].message;
}

Vec3d ReadVec(const v1::Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

void WriteVec(const Vec3d& v, v1::Vec3* out) {
  out->set_x(v.x);
  out->set_y(v.y);
  out->set_z(v.z);
}

absl::Status ReadGrid(const v1::GridRequest& in, GridRequest& out) {
  if (in.has_resolution()) {
    if (in.has_voxel_size()) return Invalid("grid.resolution", "cannot be given together with voxel_size");
    if (in.has_dims() || in.has_origin())
      return Invalid("grid.resolution", "cannot be given together with dims or origin");
    out.resolution = in.resolution();
  }
  if (absl::Status s = ReadEnum(kFits, in.fit(), "grid.fit", out.fit); !s.ok()) return s;
  if (in.has_voxel_size()) out.voxel_size = ReadVec(in.voxel_size());
  if (in.has_dims()) out.dims = {in.dims().x(), in.dims().y(), in.dims().z()};
  if (in.has_origin()) out.origin = ReadVec(in.origin());
  out.padding = in.padding();
  return absl::OkStatus();
}

absl::Status ReadShader(const v1::ShaderCall& in, const std::string& field, ShaderCall& out) {
  out.name = in.name();
  out.parameters.clear();
  out.text.clear();
  for (const v1::ShaderParameter& parameter : in.parameters()) {
    if (out.parameters.contains(parameter.name()) || out.text.contains(parameter.name())) {
      return Invalid(field, absl::StrCat("parameter '", parameter.name(), "' is given twice"));
    }
    if (!parameter.has_text()) {
      out.parameters[parameter.name()] = {parameter.values().begin(), parameter.values().end()};
    } else if (parameter.values().empty()) {
      out.text[parameter.name()] = parameter.text();
    } else {
      return Invalid(field, absl::StrCat("parameter '", parameter.name(), "' is given as text and as numbers"));
    }
  }
  return absl::OkStatus();
}

void WriteShader(const ShaderCall& in, v1::ShaderCall* out) {
  out->set_name(in.name);
  for (const auto& [name, values] : in.parameters) {
    v1::ShaderParameter* parameter = out->add_parameters();
    parameter->set_name(name);
    parameter->mutable_values()->Add(values.begin(), values.end());
  }
  for (const auto& [name, text] : in.text) {
    v1::ShaderParameter* parameter = out->add_parameters();
    parameter->set_name(name);
    parameter->set_text(text);
  }
}

absl::Status ReadTarget(const v1::RenderTarget& in, const std::string& field, TargetSpec& out) {
  if (absl::Status s = ReadEnum(kFormats, in.format(), field + ".format", out.format); !s.ok()) return s;
  if (in.blend() == v1::BLEND_UNSPECIFIED) {
    out.blend = out.format == VoxelFormat::kBit ? Blend::kOr : Blend::kReplace;
  } else if (absl::Status s = ReadEnum(kBlends, in.blend(), field + ".blend", out.blend); !s.ok()) {
    return s;
  }
  if (in.has_shader()) {
    if (absl::Status s = ReadShader(in.shader(), field + ".shader", out.shader); !s.ok()) return s;
  }
  out.components = in.has_components() ? in.components() : OwnComponents(out);
  if (in.has_quantum()) out.quantum = in.quantum();
  if (in.has_scale()) out.scale = in.scale();
  out.clear = in.clear();
  if (in.has_fill_value() && in.fill_values_size() > 0) {
    return Invalid(field + ".fill_values", "cannot be given together with fill_value");
  }
  if (in.has_fill_value()) out.fill_values = {in.fill_value()};
  if (in.fill_values_size() > 0) out.fill_values = {in.fill_values().begin(), in.fill_values().end()};
  return ReadEnum(kEncodings, in.encoding(), field + ".encoding", out.encoding);
}

absl::Status ReadSettings(const v1::VoxelizeConfig& in, CallSettings& out) {
  absl::Status s = ReadEnum(kCompressions, in.compression(), "compression", out.compression);
  if (s.ok()) s = ReadEnum(kPriorities, in.priority(), "priority", out.priority);
  if (!s.ok()) return s;
  if (in.has_fallback()) out.fallback = in.fallback();
  if (in.has_queue_timeout_ms()) {
    if (in.queue_timeout_ms() < 0) return Invalid("queue_timeout_ms", "must not be negative");
    // At most a year, so that no sum of times overflows.
    constexpr int64_t kMaxMs = int64_t{365} * 24 * 3600 * 1000;
    out.queue_timeout = std::chrono::milliseconds(std::min(in.queue_timeout_ms(), kMaxMs));
  }
  out.content_hash = !in.without_content_hash();
  return absl::OkStatus();
}

void WriteSettings(const CallSettings& in, v1::VoxelizeConfig& out) {
  if (in.compression != Compression::kNone) out.set_compression(WriteEnum(kCompressions, in.compression));
  if (in.priority != Priority::kNormal) out.set_priority(WriteEnum(kPriorities, in.priority));
  if (in.fallback) out.set_fallback(*in.fallback);
  if (in.queue_timeout) out.set_queue_timeout_ms(in.queue_timeout->count());
  out.set_without_content_hash(!in.content_hash);
}

}  // namespace

v1::MeshFormat ToMessage(MeshFormat format) {
  return WriteEnum(kMeshFormats, format);
}

v1::LengthUnit ToMessage(LengthUnit unit) {
  return WriteEnum(kUnits, unit);
}

absl::StatusOr<MeshFileType> ParseMeshType(v1::MeshFormat format, v1::LengthUnit unit, const std::string& prefix) {
  MeshFileType parsed;
  absl::Status s = ReadEnum(kMeshFormats, format, prefix + "mesh_format", parsed.format);
  if (s.ok()) s = ReadEnum(kUnits, unit, prefix + "mesh_unit", parsed.unit);
  if (!s.ok()) return s;
  return parsed;
}

absl::StatusOr<ParsedConfig> ParseConfig(const v1::VoxelizeConfig& config) {
  ParsedConfig parsed;
  VoxelizeRequest& request = parsed.request;
  const absl::StatusOr<MeshFileType> type = ParseMeshType(config.mesh_format(), config.mesh_unit());
  if (!type.ok()) return type.status();
  parsed.mesh_type = *type;
  absl::Status s;
  if (type->unit != LengthUnit::kNone && !config.mesh_id().empty()) {
    s = Invalid("mesh_unit", "a stored mesh has that of its upload; leave it out");
  }
  if (s.ok()) s = ReadGrid(config.grid(), request.grid);
  if (s.ok()) s = ReadEnum(kCoverages, config.coverage(), "coverage", request.coverage);
  if (s.ok()) s = ReadEnum(kFills, config.fill(), "fill", request.fill);
  if (s.ok()) s = ReadEnum(kLayouts, config.layout(), "layout", request.layout);
  if (s.ok()) s = ReadEnum(kBackends, config.backend(), "backend", request.backend);
  if (s.ok()) s = ReadEnum(kResults, config.result(), "result", request.result);
  if (s.ok()) s = ReadEnum(kSimds, config.simd(), "simd", request.simd);
  if (s.ok()) s = ReadSettings(config, parsed.settings);
  if (s.ok() && config.new_positions() && config.mesh_id().empty()) s = Invalid("new_positions", "of which mesh_id?");
  request.strict = config.strict();
  parsed.mesh_id = config.mesh_id();
  parsed.new_positions = config.new_positions();
  if (s.ok() && config.has_vertex_shader())
    s = ReadShader(config.vertex_shader(), "vertex_shader", request.vertex_shader);
  if (!s.ok()) return s;
  if (config.targets_size() > kMaxTargets) {
    return Invalid("targets",
                   absl::StrCat("at most ", kMaxTargets, " are possible, ", config.targets_size(), " given"));
  }
  parsed.default_targets = config.targets_size() == 0;
  parsed.default_result = config.result() == v1::RESULT_KIND_UNSPECIFIED;
  if (config.targets_size() > 0) request.targets.assign(size_t(config.targets_size()), TargetSpec{});
  for (int i = 0; i < config.targets_size(); ++i) {
    s = ReadTarget(config.targets(i), absl::StrCat("targets[", i, "]"), request.targets[size_t(i)]);
    if (!s.ok()) return s;
  }
  return parsed;
}

v1::VoxelizeConfig MakeConfig(const VoxelizeRequest& request, MeshFileType mesh_type, const CallSettings& settings) {
  v1::VoxelizeConfig config;
  config.set_mesh_format(ToMessage(mesh_type.format));
  config.set_mesh_unit(ToMessage(mesh_type.unit));
  v1::GridRequest* grid = config.mutable_grid();
  if (!request.grid.voxel_size && !request.grid.dims && !request.grid.origin)
    grid->set_resolution(request.grid.resolution);
  grid->set_fit(WriteEnum(kFits, request.grid.fit));
  if (request.grid.voxel_size) WriteVec(*request.grid.voxel_size, grid->mutable_voxel_size());
  if (request.grid.dims) {
    grid->mutable_dims()->set_x((*request.grid.dims)[0]);
    grid->mutable_dims()->set_y((*request.grid.dims)[1]);
    grid->mutable_dims()->set_z((*request.grid.dims)[2]);
  }
  if (request.grid.origin) WriteVec(*request.grid.origin, grid->mutable_origin());
  grid->set_padding(request.grid.padding);
  config.set_coverage(WriteEnum(kCoverages, request.coverage));
  config.set_fill(WriteEnum(kFills, request.fill));
  config.set_layout(WriteEnum(kLayouts, request.layout));
  config.set_backend(WriteEnum(kBackends, request.backend));
  config.set_result(WriteEnum(kResults, request.result));
  config.set_simd(WriteEnum(kSimds, request.simd));
  WriteShader(request.vertex_shader, config.mutable_vertex_shader());
  for (const TargetSpec& spec : request.targets) {
    v1::RenderTarget* target = config.add_targets();
    target->set_format(WriteEnum(kFormats, spec.format));
    target->set_components(spec.components);
    target->set_blend(WriteEnum(kBlends, spec.blend));
    WriteShader(spec.shader, target->mutable_shader());
    target->set_quantum(spec.quantum);
    if (spec.scale) target->set_scale(*spec.scale);
    target->set_clear(spec.clear);
    if (spec.fill_values.size() == 1) {
      target->set_fill_value(spec.fill_values[0]);
    } else {
      target->mutable_fill_values()->Add(spec.fill_values.begin(), spec.fill_values.end());
    }
    if (spec.encoding != Encoding::kLinear) target->set_encoding(WriteEnum(kEncodings, spec.encoding));
  }
  config.set_strict(request.strict);
  WriteSettings(settings, config);
  return config;
}

}  // namespace voxelpipe
