#include "wire/request.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "shaders/catalog.h"
#include "wire/duration.h"
#include "wire/placed.h"

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
constexpr Pair<v1::PartScope, PartScope> kScopes[] = {{v1::PART_SCOPE_WHOLE, PartScope::kWhole},
                                                      {v1::PART_SCOPE_FILE, PartScope::kFile},
                                                      {v1::PART_SCOPE_NODE, PartScope::kNode},
                                                      {v1::PART_SCOPE_MESH, PartScope::kMesh},
                                                      {v1::PART_SCOPE_MATERIAL, PartScope::kMaterial}};
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

template <typename Message, typename Core, size_t N>
std::string_view NameIn(const Pair<Message, Core> (&pairs)[N], Message message) {
  for (const auto& pair : pairs) {
    if (pair.message == message) return Name(pair.core);
  }
  return "";
}

template <typename Message, typename Core, size_t N>
Message Named(const Pair<Message, Core> (&pairs)[N], std::string_view name) {
  for (const auto& pair : pairs) {
    if (Name(pair.core) == name) return pair.message;
  }
  return Message(0);
}

Vec3d ReadVec(const v1::Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

void WriteVec(const Vec3d& v, v1::Vec3* out) {
  out->set_x(v.x);
  out->set_y(v.y);
  out->set_z(v.z);
}

std::array<int64_t, 3> ReadDims(const v1::Dims& dims) {
  return {dims.x(), dims.y(), dims.z()};
}

void WriteDims(const std::array<int64_t, 3>& dims, v1::Dims* out) {
  out->set_x(dims[0]);
  out->set_y(dims[1]);
  out->set_z(dims[2]);
}

absl::Status ReadGrid(const v1::GridRequest& in, GridRequest& out) {
  out.padding = in.padding();
  switch (in.form_case()) {
    case v1::GridRequest::kResolution:
      if (in.resolution().has_voxels()) out.resolution = in.resolution().voxels();
      return ReadEnum(kFits, in.resolution().fit(), "grid.fit", out.fit);
    case v1::GridRequest::kVoxelSize: out.voxel_size = ReadVec(in.voxel_size()); break;
    case v1::GridRequest::kDims: out.dims = ReadDims(in.dims()); break;
    case v1::GridRequest::kPlacement: {
      const v1::GridPlacement& placement = in.placement();
      if (!placement.has_dims() || !placement.has_origin() || !placement.has_voxel_size()) {
        return Invalid("grid.placement", "dims, origin and voxel_size are needed together");
      }
      out.dims = ReadDims(placement.dims());
      out.origin = ReadVec(placement.origin());
      out.voxel_size = ReadVec(placement.voxel_size());
      break;
    }
    case v1::GridRequest::FORM_NOT_SET: break;
  }
  return absl::OkStatus();
}

void WriteGrid(const GridRequest& in, v1::GridRequest& out) {
  out.set_padding(in.padding);
  if (in.given()) {
    v1::GridPlacement& placement = *out.mutable_placement();
    WriteDims(*in.dims, placement.mutable_dims());
    WriteVec(*in.origin, placement.mutable_origin());
    WriteVec(*in.voxel_size, placement.mutable_voxel_size());
  } else if (in.dims) {
    WriteDims(*in.dims, out.mutable_dims());
  } else if (in.voxel_size) {
    WriteVec(*in.voxel_size, out.mutable_voxel_size());
  } else {
    out.mutable_resolution()->set_voxels(in.resolution);
    out.mutable_resolution()->set_fit(WriteEnum(kFits, in.fit));
  }
}

absl::Status ReadShader(const v1::ShaderCall& in, const std::string& field, ShaderCall& out) {
  out.name = in.name();
  out.parameters.clear();
  out.text.clear();
  for (const v1::ShaderParameter& parameter : in.parameters()) {
    if (out.parameters.contains(parameter.name()) || out.text.contains(parameter.name())) {
      return Invalid(field, absl::StrCat("parameter '", parameter.name(), "' is given twice"));
    }
    if (parameter.has_text()) {
      out.text[parameter.name()] = parameter.text();
    } else {
      const auto& values = parameter.numbers().values();
      out.parameters[parameter.name()] = {values.begin(), values.end()};
    }
  }
  return absl::OkStatus();
}

void WriteShader(const ShaderCall& in, v1::ShaderCall* out) {
  out->set_name(in.name);
  for (const auto& [name, values] : in.parameters) {
    v1::ShaderParameter* parameter = out->add_parameters();
    parameter->set_name(name);
    parameter->mutable_numbers()->mutable_values()->Add(values.begin(), values.end());
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
  if (in.has_clear()) out.clear = in.clear();
  out.fill_values = {in.fill().begin(), in.fill().end()};
  return ReadEnum(kEncodings, in.encoding(), field + ".encoding", out.encoding);
}

void WriteTarget(const TargetSpec& in, v1::RenderTarget& out) {
  out.set_format(WriteEnum(kFormats, in.format));
  out.set_components(in.components);
  out.set_blend(WriteEnum(kBlends, in.blend));
  WriteShader(in.shader, out.mutable_shader());
  out.set_quantum(in.quantum);
  if (in.scale) out.set_scale(*in.scale);
  out.set_clear(in.clear);
  out.mutable_fill()->Add(in.fill_values.begin(), in.fill_values.end());
  out.set_encoding(WriteEnum(kEncodings, in.encoding));
}

absl::Status CheckPartRules(PartScope scope, const std::string& field, int count) {
  if (count == 0) return absl::OkStatus();
  if (scope == PartScope::kWhole) return Invalid(field, "needs parts.scope: file, node, mesh or material");
  if (count <= int(kMaxPartRules)) return absl::OkStatus();
  return Invalid(field, absl::StrCat("at most ", kMaxPartRules, " are possible, ", count, " given"));
}

absl::Status ReadRules(const google::protobuf::RepeatedPtrField<v1::PartRule>& in, const std::string& field,
                       int64_t min, int64_t max, std::vector<PartRule>& out) {
  out.reserve(size_t(in.size()));
  for (int i = 0; i < in.size(); ++i) {
    const int64_t number = in[i].number();
    if (number < min || number > max) {
      return Invalid(absl::StrCat(field, "[", i, "].number"),
                     absl::StrCat(number, " is not a whole number from ", min, " to ", max));
    }
    out.push_back({in[i].pattern(), number});
  }
  return absl::OkStatus();
}

absl::Status ReadParts(const v1::PartSelection& in, PartSelection& out) {
  absl::Status s = ReadEnum(kScopes, in.scope(), "parts.scope", out.scope);
  if (s.ok()) s = CheckPartRules(out.scope, "parts.labels", in.labels_size());
  if (s.ok()) s = CheckPartRules(out.scope, "parts.priorities", in.priorities_size());
  if (s.ok()) s = CheckPartRules(out.scope, "parts.exclude", in.exclude_size());
  if (s.ok()) s = ReadRules(in.labels(), "parts.labels", 1, UINT32_MAX, out.labels);
  if (s.ok()) s = ReadRules(in.priorities(), "parts.priorities", INT32_MIN, INT32_MAX, out.priorities);
  if (s.ok()) out.exclude = {in.exclude().begin(), in.exclude().end()};
  return s;
}

void WriteRules(const std::vector<PartRule>& in, google::protobuf::RepeatedPtrField<v1::PartRule>& out) {
  for (const PartRule& rule : in) {
    v1::PartRule& written = *out.Add();
    written.set_pattern(rule.pattern);
    written.set_number(rule.number);
  }
}

void WriteParts(const PartSelection& in, v1::PartSelection& out) {
  out.set_scope(WriteEnum(kScopes, in.scope));
  WriteRules(in.labels, *out.mutable_labels());
  WriteRules(in.priorities, *out.mutable_priorities());
  for (const std::string& pattern : in.exclude) out.add_exclude(pattern);
}

absl::Status ReadSpec(const v1::VoxelizeSpec& in, ParsedConfig& out) {
  VoxelizeRequest& request = out.request;
  absl::Status s = ReadGrid(in.grid(), request.grid);
  if (s.ok()) s = ReadEnum(kCoverages, in.coverage(), "coverage", request.coverage);
  if (s.ok()) s = ReadEnum(kFills, in.fill(), "fill", request.fill);
  if (s.ok()) s = ReadParts(in.parts(), request.parts);
  if (s.ok()) s = ReadEnum(kLayouts, in.layout(), "layout", request.layout);
  if (s.ok()) s = ReadEnum(kResults, in.result(), "result", request.result);
  if (s.ok() && in.has_vertex_shader()) s = ReadShader(in.vertex_shader(), "vertex_shader", request.vertex_shader);
  if (!s.ok()) return s;
  request.strict = in.strict();
  if (in.targets_size() > kMaxTargets) {
    return Invalid("targets", absl::StrCat("at most ", kMaxTargets, " are possible, ", in.targets_size(), " given"));
  }
  out.default_targets = in.targets_size() == 0;
  out.default_result = in.result() == v1::RESULT_KIND_UNSPECIFIED;
  if (in.targets_size() > 0) request.targets.assign(size_t(in.targets_size()), TargetSpec{});
  for (int i = 0; i < in.targets_size(); ++i) {
    s = ReadTarget(in.targets(i), absl::StrCat("targets[", i, "]"), request.targets[size_t(i)]);
    if (!s.ok()) return s;
  }
  return absl::OkStatus();
}

absl::Status ReadExecution(const v1::Execution& in, ParsedConfig& out) {
  absl::Status s = ReadEnum(kBackends, in.backend(), "backend", out.request.backend);
  if (s.ok()) s = ReadEnum(kSimds, in.simd(), "simd", out.request.simd);
  if (s.ok()) s = ReadEnum(kPriorities, in.priority(), "priority", out.settings.priority);
  if (!s.ok()) return s;
  if (in.has_fallback()) out.settings.fallback = in.fallback();
  if (in.has_queue_timeout()) {
    const absl::StatusOr<std::chrono::milliseconds> time = ReadTimeout(in.queue_timeout(), "queue_timeout");
    if (!time.ok()) return time.status();
    out.settings.queue_timeout = *time;
  }
  return absl::OkStatus();
}

absl::Status ReadDelivery(const v1::Delivery& in, CallSettings& out) {
  if (absl::Status s = ReadEnum(kCompressions, in.compression(), "compression", out.compression); !s.ok()) return s;
  if (in.has_content_hash()) out.content_hash = in.content_hash();
  if (in.has_single_message_bytes()) {
    if (in.single_message_bytes() < 0) return Invalid("single_message_bytes", "must not be negative");
    out.single_message_bytes = in.single_message_bytes();
  }
  return absl::OkStatus();
}

}  // namespace

v1::MeshFormat ToMessage(MeshFormat format) {
  return WriteEnum(kMeshFormats, format);
}

v1::LengthUnit ToMessage(LengthUnit unit) {
  return WriteEnum(kUnits, unit);
}

v1::Backend ToMessage(BackendChoice backend) {
  return WriteEnum(kBackends, backend);
}

v1::Simd ToMessage(SimdChoice simd) {
  return WriteEnum(kSimds, simd);
}

v1::Layout ToMessage(Layout layout) {
  return WriteEnum(kLayouts, layout);
}

v1::ResultKind ToMessage(ResultKind kind) {
  return WriteEnum(kResults, kind);
}

std::string_view NameOf(v1::Backend backend) {
  return NameIn(kBackends, backend);
}

std::string_view NameOf(v1::Simd simd) {
  return NameIn(kSimds, simd);
}

std::string_view NameOf(v1::MeshFormat format) {
  return NameIn(kMeshFormats, format);
}

v1::Backend BackendNamed(std::string_view name) {
  return Named(kBackends, name);
}

v1::Simd SimdNamed(std::string_view name) {
  return Named(kSimds, name);
}

v1::MeshFormat MeshFormatNamed(std::string_view name) {
  return Named(kMeshFormats, name);
}

absl::StatusOr<MeshFileType> ParseMeshType(v1::MeshFormat format, v1::LengthUnit unit, const std::string& prefix) {
  MeshFileType parsed;
  absl::Status s = ReadEnum(kMeshFormats, format, prefix + "format", parsed.format);
  if (s.ok()) s = ReadEnum(kUnits, unit, prefix + "unit", parsed.unit);
  if (!s.ok()) return s;
  return parsed;
}

absl::Status ParseMesh(const v1::MeshSource& mesh, ParsedConfig& out) {
  if (mesh.has_stored()) {
    if (mesh.stored().name().empty()) return Invalid("mesh.stored.name", "is empty");
    out.mesh_name = mesh.stored().name();
    out.new_positions = mesh.stored().has_positions();
    return absl::OkStatus();
  }
  if (mesh.has_placed()) {
    absl::StatusOr<std::vector<PlacedStored>> placed = ParsePlaced(mesh.placed());
    if (!placed.ok()) return placed.status();
    out.placed = std::make_shared<const std::vector<PlacedStored>>(*std::move(placed));
    return absl::OkStatus();
  }
  const absl::StatusOr<MeshFileType> type = ParseMeshType(mesh.bytes().format(), mesh.bytes().unit(), "mesh.bytes.");
  if (!type.ok()) return type.status();
  out.mesh_type = *type;
  return absl::OkStatus();
}

absl::StatusOr<ParsedConfig> ParseRequest(const v1::VoxelizeRequest& request) {
  ParsedConfig parsed;
  absl::Status s = ParseMesh(request.mesh(), parsed);
  if (s.ok()) s = ReadSpec(request.spec(), parsed);
  if (s.ok()) s = ReadExecution(request.execution(), parsed);
  if (s.ok()) s = ReadDelivery(request.delivery(), parsed.settings);
  if (!s.ok()) return s;
  return parsed;
}

absl::StatusOr<ParsedConfig> ParseRequest(const v1::VoxelizeSpec& spec, const v1::Execution& execution) {
  ParsedConfig parsed;
  absl::Status s = ReadSpec(spec, parsed);
  if (s.ok()) s = ReadExecution(execution, parsed);
  if (!s.ok()) return s;
  return parsed;
}

void WriteTo(const VoxelizeRequest& request, v1::VoxelizeSpec& spec) {
  WriteGrid(request.grid, *spec.mutable_grid());
  spec.set_coverage(WriteEnum(kCoverages, request.coverage));
  spec.set_fill(WriteEnum(kFills, request.fill));
  WriteParts(request.parts, *spec.mutable_parts());
  WriteShader(request.vertex_shader, spec.mutable_vertex_shader());
  for (const TargetSpec& target : request.targets) WriteTarget(target, *spec.add_targets());
  spec.set_layout(WriteEnum(kLayouts, request.layout));
  spec.set_result(WriteEnum(kResults, request.result));
  spec.set_strict(request.strict);
}

v1::VoxelizeSpec MakeSpec(const VoxelizeRequest& request) {
  v1::VoxelizeSpec spec;
  WriteTo(request, spec);
  return spec;
}

v1::Execution MakeExecution(const VoxelizeRequest& request, const CallSettings& settings) {
  v1::Execution out;
  out.set_backend(WriteEnum(kBackends, request.backend));
  out.set_simd(WriteEnum(kSimds, request.simd));
  if (settings.priority != Priority::kNormal) out.set_priority(WriteEnum(kPriorities, settings.priority));
  if (settings.queue_timeout) WriteTo(*settings.queue_timeout, *out.mutable_queue_timeout());
  if (settings.fallback) out.set_fallback(*settings.fallback);
  return out;
}

v1::Delivery MakeDelivery(const CallSettings& settings) {
  v1::Delivery out;
  if (settings.compression != Compression::kNone) out.set_compression(WriteEnum(kCompressions, settings.compression));
  if (!settings.content_hash) out.set_content_hash(false);
  if (settings.single_message_bytes) out.set_single_message_bytes(*settings.single_message_bytes);
  return out;
}

v1::VoxelizeRequest MakeRequest(const VoxelizeRequest& request, const CallSettings& settings) {
  v1::VoxelizeRequest out;
  WriteTo(request, *out.mutable_spec());
  *out.mutable_execution() = MakeExecution(request, settings);
  *out.mutable_delivery() = MakeDelivery(settings);
  return out;
}

void WriteTo(const MeshFileType& type, v1::MeshBytes& message) {
  message.set_format(ToMessage(type.format));
  message.set_unit(ToMessage(type.unit));
}

}  // namespace voxelpipe
