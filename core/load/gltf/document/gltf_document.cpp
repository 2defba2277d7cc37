#include "load/gltf/document/gltf_document.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "base/checked.h"
#include "load/gltf/document/gltf_extensions.h"
#include "load/gltf/document/gltf_fields.h"
#include "load/gltf/document/gltf_json.h"
#include "load/gltf/document/gltf_sanitize.h"
#include "load/gltf/document/json_guard.h"

namespace voxelpipe::gltf {
namespace {

absl::Status CheckVersion(const Fields& root) {
  absl::Status status;
  const Json* asset = root.Find("asset");
  if (asset == nullptr)
    return absl::InvalidArgumentError("glTF: the asset object is missing (needed: asset.version 2.0)");
  Fields fields(*asset, "asset", status);
  const std::string version = fields.String("version");
  const std::string least = fields.String("minVersion", "2.0");
  if (!status.ok()) return status;
  if (!absl::StartsWith(version, "2.")) {
    return absl::InvalidArgumentError(absl::StrCat("glTF: asset.version ", Quoted(version),
                                                   " is not supported, only 2.x (glTF 1.0 is another format)"));
  }
  // A later 2.x may only add features that a 2.0 reader can ignore, so minVersion 2.1 does not refuse the geometry.
  if (!absl::StartsWith(least, "2.")) {
    return absl::InvalidArgumentError(
        absl::StrCat("glTF: asset.minVersion ", Quoted(least), " is not supported, only 2.x"));
  }
  return absl::OkStatus();
}

absl::Status CheckExtensions(const Fields& root, WarningList& warnings) {
  const Json* required = root.Find("extensionsRequired");
  if (required == nullptr) return absl::OkStatus();
  if (!required->is_array()) return absl::InvalidArgumentError("glTF: extensionsRequired is not an array");
  constexpr size_t kMaxNames = 1000;  // more than there are extensions
  if (required->size() > kMaxNames) {
    return absl::InvalidArgumentError(
        absl::StrCat("glTF: extensionsRequired has ", required->size(), " entries; the most is ", kMaxNames));
  }
  for (const Json& entry : *required) {
    if (!entry.is_string())
      return absl::InvalidArgumentError("glTF: extensionsRequired has an entry that is no string");
    const std::string& name = entry.get_ref<const std::string&>();
    switch (SupportOf(name)) {
      case ExtensionSupport::kRead: break;
      case ExtensionSupport::kIgnored:
        warnings.Add(WarningCode::kExtensionIgnored, "extensionsRequired",
                     absl::StrCat(Quoted(name), " is not read: it cannot change the result"));
        break;
      case ExtensionSupport::kRefused:
        return absl::InvalidArgumentError(
            absl::StrCat("glTF: extensionsRequired names ", Quoted(name), ", which is not supported"));
    }
  }
  return absl::OkStatus();
}

const Json* Extension(const Fields& fields, const char* name) {
  const Json* extensions = fields.Find("extensions");
  if (extensions == nullptr || !extensions->is_object()) return nullptr;
  const auto it = extensions->find(name);
  return it == extensions->end() ? nullptr : &*it;
}

// Under either name of meshopt's compression; `khr` says which.
const Json* MeshoptExtension(const Fields& fields, bool& khr) {
  const Json* object = Extension(fields, "KHR_meshopt_compression");
  khr = object != nullptr;
  return khr ? object : Extension(fields, "EXT_meshopt_compression");
}

void ReadBuffers(const JobContext& job, const Json& array, Document& document, absl::Status& status) {
  for (size_t i = 0; i < array.size() && GoOn(job, i, status); ++i) {
    Fields fields(array[i], absl::StrCat("buffer ", i), status);
    BufferDecl buffer;
    buffer.byte_length = fields.RequiredUnsigned("byteLength");
    if (fields.Find("uri") != nullptr) buffer.uri = fields.String("uri");
    bool khr = false;
    if (const Json* meshopt = MeshoptExtension(fields, khr)) {
      buffer.fallback = Fields(*meshopt, fields.where(), status).Bool("fallback", false);
    }
    document.buffers.push_back(std::move(buffer));
  }
}

void CheckRange(Fields& fields, uint64_t offset, uint64_t length, uint32_t buffer, const Document& document) {
  const std::optional<uint64_t> end = CheckedAdd(offset, length);
  if (fields.ok() && (!end || *end > document.buffers[buffer].byte_length)) {
    fields.Fail(absl::StrCat("byteOffset ", offset, " + byteLength ", length, " exceeds buffer ", buffer, " of ",
                             document.buffers[buffer].byte_length, " bytes"));
  }
}

// glTF 2.0 forbids other strides (bufferView.byteStride). They are read nevertheless; the fault may be in an offset
// that looks right.
void WarnOfStride(uint64_t stride, size_t view, Document& document) {
  if (stride == 0 || (stride >= 4 && stride <= 252 && stride % 4 == 0)) return;
  document.warnings.Add(WarningCode::kNonconformingFile, absl::StrCat("bufferView ", view),
                        absl::StrCat("byteStride ", stride, " is no multiple of 4 from 4 to 252"));
}

void ReadViews(const JobContext& job, const Json& array, Document& document, absl::Status& status) {
  for (size_t i = 0; i < array.size() && GoOn(job, i, status); ++i) {
    Fields fields(array[i], absl::StrCat("bufferView ", i), status);
    ViewDecl view;
    view.buffer = fields.RequiredIndex("buffer", document.buffers.size(), "buffers");
    view.offset = fields.Unsigned("byteOffset", 0);
    view.length = fields.RequiredUnsigned("byteLength");
    view.stride = fields.Unsigned("byteStride", 0);
    WarnOfStride(view.stride, i, document);
    CheckRange(fields, view.offset, view.length, view.buffer, document);
    MeshoptDecl meshopt;
    if (const Json* object = MeshoptExtension(fields, meshopt.khr)) {
      const char* const name = meshopt.khr ? "KHR_meshopt_compression" : "EXT_meshopt_compression";
      Fields extension(*object, absl::StrCat("bufferView ", i, ", ", name), status);
      meshopt.buffer = extension.RequiredIndex("buffer", document.buffers.size(), "buffers");
      meshopt.offset = extension.Unsigned("byteOffset", 0);
      meshopt.length = extension.RequiredUnsigned("byteLength");
      meshopt.stride = extension.RequiredUnsigned("byteStride");
      meshopt.count = extension.RequiredUnsigned("count");
      meshopt.mode = extension.String("mode");
      meshopt.filter = extension.String("filter", "NONE");
      CheckRange(extension, meshopt.offset, meshopt.length, meshopt.buffer, document);
      view.meshopt = std::move(meshopt);
    }
    document.views.push_back(std::move(view));
  }
}

void ReadType(Fields& fields, AccessorDecl& accessor) {
  struct Type {
    const char* name;
    int components;
    bool matrix;
  };
  constexpr Type kTypes[] = {{"SCALAR", 1, false}, {"VEC2", 2, false}, {"VEC3", 3, false}, {"VEC4", 4, false},
                             {"MAT2", 4, true},    {"MAT3", 9, true},  {"MAT4", 16, true}};
  const std::string name = fields.String("type");
  for (const Type& type : kTypes) {
    if (name != type.name) continue;
    accessor.components = type.components;
    accessor.matrix = type.matrix;
    return;
  }
  fields.Fail(absl::StrCat("type ", Quoted(name), " is none of glTF's"));
}

int ReadComponentType(Fields& fields) {
  const uint64_t type = fields.RequiredUnsigned("componentType");
  if (type > kDoubleComponents || ComponentBytes(static_cast<int>(type)) == 0) {
    fields.Fail(absl::StrCat("componentType ", type, " is none of glTF's"));
    return 5126;
  }
  return static_cast<int>(type);
}

void ReadSparse(const Json& object, size_t index, const Document& document, AccessorDecl& accessor,
                absl::Status& status) {
  const std::string where = absl::StrCat("accessor ", index, ", sparse");
  Fields fields(object, where, status);
  const Json* indices = fields.Find("indices");
  const Json* values = fields.Find("values");
  if (indices == nullptr || values == nullptr) return fields.Fail("indices or values are missing");
  Fields index_fields(*indices, where + " indices", status), value_fields(*values, where + " values", status);
  SparseDecl sparse;
  sparse.count = fields.RequiredUnsigned("count");
  if (sparse.count > accessor.count) fields.Fail(absl::StrCat("count ", sparse.count, " exceeds the accessor's"));
  sparse.index_view = index_fields.RequiredIndex("bufferView", document.views.size(), "bufferViews");
  sparse.index_offset = index_fields.Unsigned("byteOffset", 0);
  sparse.index_type = ReadComponentType(index_fields);
  sparse.value_view = value_fields.RequiredIndex("bufferView", document.views.size(), "bufferViews");
  sparse.value_offset = value_fields.Unsigned("byteOffset", 0);
  accessor.sparse = sparse;
}

void ReadAccessors(const JobContext& job, const Json& array, Document& document, absl::Status& status) {
  for (size_t i = 0; i < array.size() && GoOn(job, i, status); ++i) {
    Fields fields(array[i], absl::StrCat("accessor ", i), status);
    AccessorDecl accessor;
    accessor.view = fields.Index("bufferView", document.views.size(), "bufferViews");
    accessor.offset = fields.Unsigned("byteOffset", 0);
    accessor.count = fields.RequiredUnsigned("count");
    accessor.component_type = ReadComponentType(fields);
    accessor.normalized = fields.Bool("normalized", false);
    ReadType(fields, accessor);
    if (const Json* sparse = fields.Find("sparse")) ReadSparse(*sparse, i, document, accessor, status);
    document.accessors.push_back(accessor);
  }
}

// Images never fail a document, unless a URI is not valid.
void ReadImages(const JobContext& job, Json& array, Document& document, absl::Status& status) {
  for (size_t i = 0; i < array.size() && GoOn(job, i, status); ++i) {
    absl::Status ignored;
    Fields fields(array[i], absl::StrCat("image ", i), ignored);
    ImageDecl image;
    image.name = fields.String("name");
    image.mime_type = fields.String("mimeType");
    image.view = fields.Index("bufferView", document.views.size(), "bufferViews");
    if (fields.Find("uri") != nullptr) {
      image.uri = fields.String("uri");
      if (absl::StartsWith(*image.uri, ":")) {
        status = absl::InvalidArgumentError(absl::StrCat("glTF: image ", i, ": ", Quoted(*image.uri), " is not a URI"));
      }
    }
    AddIgnored(ignored, absl::StrCat("image ", i), document.warnings);
    document.images.push_back(std::move(image));
  }
}

// CESIUM_RTC: the point that positions are relative to. An incomplete centre is an error, because it would misplace the
// mesh.
void ReadRtcCenter(const Fields& root, Document& document, absl::Status& status) {
  const Json* const object = Extension(root, "CESIUM_RTC");
  if (object == nullptr) return;
  Fields fields(*object, "CESIUM_RTC", status);
  const Json* const center = fields.Array("center");
  if (center == nullptr || center->size() != 3) return fields.Fail("center is not 3 numbers");
  Vec3d at;
  for (int a = 0; a < 3; ++a) {
    const Json& number = (*center)[size_t(a)];
    if (!number.is_number()) return fields.Fail("center is not 3 numbers");
    at[a] = number.get<double>();
    if (!std::isfinite(at[a])) return fields.Fail("center is not finite");
  }
  document.rtc_center = at;
}

// `memory` is the charge of `root`.
absl::StatusOr<Document> ReadDocument(const JobContext& job, Json& root, const LoadLimits& limits,
                                      MemoryCharge memory) {
  absl::Status status;
  Fields fields(root, "document", status);
  if (!status.ok()) return absl::InvalidArgumentError("glTF: the JSON is not an object");
  if (absl::Status bad = CheckVersion(fields); !bad.ok()) return bad;
  Document document;
  if (absl::Status bad = CheckExtensions(fields, document.warnings); !bad.ok()) return bad;
  document.has_scenes = ArraySize(root, "scenes") > 0;
  ReadRtcCenter(fields, document, status);
  if (const Json* array = fields.Array("buffers", kMaxElements)) ReadBuffers(job, *array, document, status);
  if (const Json* array = fields.Array("bufferViews", kMaxElements)) ReadViews(job, *array, document, status);
  if (const Json* array = fields.Array("accessors", kMaxElements)) ReadAccessors(job, *array, document, status);
  if (fields.Array("images", kMaxElements) != nullptr) ReadImages(job, root["images"], document, status);
  if (!status.ok()) return status;

  // Unchecked: a fault of an animation matters only to requests that use it.
  if (const auto it = root.find("animations"); it != root.end() && it->is_array() && !it->empty()) {
    document.animations = std::make_shared<Json>(std::move(*it));
  }
  // A copy of a part of the tree.
  if (absl::Status full = memory.Grow(memory.bytes(), "glTF: the JSON:"); !full.ok()) return full;
  absl::StatusOr<Json> graph = SanitizeGraph(job, root, limits, document.warnings);
  if (!graph.ok()) return graph.status();
  document.graph = std::make_shared<Json>(*std::move(graph));
  document.memory = std::move(memory);
  return document;
}

}  // namespace

uint32_t ComponentBytes(int component_type) {
  switch (component_type) {
    case 5120:
    case 5121: return 1;
    case 5122:
    case 5123: return 2;
    case 5125:
    case 5126: return 4;
    case kDoubleComponents: return 8;
    default: return 0;
  }
}

absl::StatusOr<Document> ParseDocument(const JobContext& job, std::string_view json, const LoadLimits& limits) {
  try {
    MemoryCharge memory(&MemoryOf(job));
    absl::StatusOr<Json> root = ParseJson(job, json, limits, memory);
    if (!root.ok()) return root.status();
    return ReadDocument(job, *root, limits, std::move(memory));
  } catch (const Json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", Quoted(error.what())));
  }
}

}  // namespace voxelpipe::gltf
