// Source: Draco bitstream specification 2.2 (Google, 2018), sections on the header, metadata and connectivity.
#include "load/draco.h"

#include <draco/attributes/point_attribute.h>
#include <draco/compression/decode.h>
#include <draco/compression/point_cloud/point_cloud_decoder.h>
#include <draco/core/varint_decoding.h>
#include <draco/metadata/metadata_decoder.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "load/draco_orientations.h"
#include "load/foreign_decoders.h"

namespace voxelpipe {
namespace {

// The densest real streams spend about a tenth of a byte on a triangle or a point; a declared count beyond this is a bomb.
constexpr uint64_t kMaxElementsPerByte = 64;

struct DeclaredCounts {
  uint64_t faces = 0, points = 0;
  bool is_mesh = false;
};

absl::Status Invalid(const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat("draco: ", why));
}

// A count that older bitstreams store in four bytes and newer ones as a varint.
bool ReadCount(draco::DecoderBuffer& buffer, bool fixed, uint64_t& count) {
  uint32_t value = 0;
  const bool ok = fixed ? buffer.Decode(&value) : draco::DecodeVarint(&value, &buffer);
  count = value;
  return ok;
}

// What the stream's connectivity says it holds, read before the decoder allocates for it.
absl::StatusOr<DeclaredCounts> ReadDeclaredCounts(std::span<const uint8_t> bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::DracoHeader header;
  if (const draco::Status s = draco::PointCloudDecoder::DecodeHeader(&buffer, &header); !s.ok()) {
    return Invalid(absl::StrCat("bad header in the first bytes of ", bytes.size(), " (", s.error_msg_string(), ")"));
  }
  const uint16_t version = DRACO_BITSTREAM_VERSION(header.version_major, header.version_minor);
  if (version > DRACO_BITSTREAM_VERSION(2, 3)) {
    return Invalid(absl::StrCat("bitstream version ", int(header.version_major), ".", int(header.version_minor),
                                " at byte 5 is not supported"));
  }
  buffer.set_bitstream_version(version);
  if (version >= DRACO_BITSTREAM_VERSION(1, 3) && (header.flags & METADATA_FLAG_MASK) != 0) {
    auto metadata = std::make_unique<draco::GeometryMetadata>();
    if (!draco::MetadataDecoder().DecodeGeometryMetadata(&buffer, metadata.get())) return Invalid("broken metadata");
  }
  DeclaredCounts counts;
  bool ok = true;
  if (header.encoder_type == draco::TRIANGULAR_MESH) {
    counts.is_mesh = true;
    if (header.encoder_method == draco::MESH_SEQUENTIAL_ENCODING) {
      const bool fixed = version < DRACO_BITSTREAM_VERSION(2, 2);
      ok = ReadCount(buffer, fixed, counts.faces) && ReadCount(buffer, fixed, counts.points);
    } else {
      const bool fixed = version < DRACO_BITSTREAM_VERSION(2, 0);
      uint8_t traversal = 0;
      uint64_t new_vertices = 0;
      ok = buffer.Decode(&traversal);
      if (version < DRACO_BITSTREAM_VERSION(2, 2)) ok = ok && ReadCount(buffer, fixed, new_vertices);
      ok = ok && ReadCount(buffer, fixed, counts.points) && ReadCount(buffer, fixed, counts.faces);
    }
  } else if (header.encoder_type == draco::POINT_CLOUD) {
    ok = ReadCount(buffer, true, counts.points);
  } else {
    return Invalid(absl::StrCat("unknown geometry type ", int(header.encoder_type), " at byte 7"));
  }
  if (!ok) return Invalid(absl::StrCat("the stream of ", bytes.size(), " bytes ends before its element counts"));
  return counts;
}

absl::Status CheckCounts(const DeclaredCounts& counts, uint64_t bytes, const LoadLimits& limits) {
  const uint64_t most = bytes * kMaxElementsPerByte;
  if (counts.faces > most || counts.points > most) {
    return Invalid(absl::StrCat("the header declares ", counts.faces, " faces and ", counts.points,
                                " points, more than ", bytes, " bytes can hold"));
  }
  if (counts.faces > limits.max_triangles) {
    return absl::ResourceExhaustedError(
        absl::StrCat("draco: ", counts.faces, " triangles, the limit is ", limits.max_triangles));
  }
  if (counts.points > limits.max_vertices) {
    return absl::ResourceExhaustedError(
        absl::StrCat("draco: ", counts.points, " vertices, the limit is ", limits.max_vertices));
  }
  return absl::OkStatus();
}

DracoAttribute::Kind KindOf(draco::GeometryAttribute::Type type) {
  switch (type) {
    case draco::GeometryAttribute::POSITION: return DracoAttribute::Kind::kPosition;
    case draco::GeometryAttribute::NORMAL: return DracoAttribute::Kind::kNormal;
    case draco::GeometryAttribute::COLOR: return DracoAttribute::Kind::kColor;
    case draco::GeometryAttribute::TEX_COORD: return DracoAttribute::Kind::kTexCoord;
    default: return DracoAttribute::Kind::kOther;
  }
}

double IntegerMost(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8: return 127;
    case draco::DT_UINT8: return 255;
    case draco::DT_INT16: return 32767;
    case draco::DT_UINT16: return 65535;
    case draco::DT_INT32: return 2147483647;
    case draco::DT_UINT32: return 4294967295;
    case draco::DT_INT64: return 0x1p63;
    case draco::DT_UINT64: return 0x1p64;
    default: return 0;
  }
}

// `attribute` is no longer normalized afterwards: Draco's own conversion would not clamp as glTF wants it.
absl::StatusOr<DracoAttribute> ReadAttribute(draco::PointAttribute& attribute, uint32_t points) {
  DracoAttribute out;
  out.unique_id = attribute.unique_id();
  out.kind = KindOf(attribute.attribute_type());
  out.components = attribute.num_components();
  out.integer_most = IntegerMost(attribute.data_type());
  const bool unsigned_short = attribute.data_type() == draco::DT_UINT8 || attribute.data_type() == draco::DT_UINT16;
  out.normalized = attribute.normalized() || (out.kind == DracoAttribute::Kind::kColor && unsigned_short);
  attribute.set_normalized(false);
  if (out.components < 1 || out.components > 4) {
    return Invalid(absl::StrCat("attribute ", out.unique_id, " has ", out.components, " components"));
  }
  out.values.resize(size_t(points) * size_t(out.components));
  for (uint32_t i = 0; i < points; ++i) {
    const draco::AttributeValueIndex at = attribute.mapped_index(draco::PointIndex(i));
    float* value = out.values.data() + size_t(i) * size_t(out.components);
    if (at.value() >= attribute.size() || !attribute.ConvertValue<float>(at, int8_t(out.components), value)) {
      return Invalid(absl::StrCat("attribute ", out.unique_id, " has no value for point ", i));
    }
    if (out.kind != DracoAttribute::Kind::kPosition) continue;
    for (int c = 0; c < out.components; ++c) {
      if (!std::isfinite(value[c])) return Invalid(absl::StrCat("the position of point ", i, " is not finite"));
    }
  }
  return out;
}

absl::StatusOr<DracoMesh> Decode(std::span<const uint8_t> bytes, bool is_mesh, const LoadLimits& limits) {
  DracoMesh out;
  if (!is_mesh) return out;  // a point cloud has nothing to voxelize
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return Invalid(decoded.status().error_msg_string());
  const std::unique_ptr<draco::Mesh> mesh = std::move(decoded).value();
  if (mesh->num_faces() > limits.max_triangles || mesh->num_points() > limits.max_vertices) {
    return absl::ResourceExhaustedError(absl::StrCat("draco: ", mesh->num_faces(), " triangles and ",
                                                     mesh->num_points(), " vertices, the limits are ",
                                                     limits.max_triangles, " and ", limits.max_vertices));
  }
  out.points = mesh->num_points();
  out.triangles.reserve(mesh->num_faces());
  for (draco::FaceIndex f(0); f < mesh->num_faces(); ++f) {
    const draco::Mesh::Face& face = mesh->face(f);
    const std::array<uint32_t, 3> t{face[0].value(), face[1].value(), face[2].value()};
    for (const uint32_t v : t) {
      if (v >= out.points) return Invalid(absl::StrCat("face ", f.value(), " refers to point ", v, " of ", out.points));
    }
    out.triangles.push_back(t);
  }
  for (int32_t i = 0; i < mesh->num_attributes(); ++i) {
    draco::PointAttribute& attribute = *mesh->attribute(i);
    // Custom data of too many components, which no shader could read. Draco's conversion of DT_BOOL loads a stranger's byte as a bool, which is undefined.
    if (attribute.num_components() > 4 || attribute.data_type() == draco::DT_BOOL) continue;
    auto read = ReadAttribute(attribute, out.points);
    if (!read.ok()) return read.status();
    if (const draco::AttributeMetadata* const metadata = mesh->GetAttributeMetadataByAttributeId(i)) {
      metadata->GetEntryString("name", &read->name);
    }
    out.attributes.push_back(*std::move(read));
  }
  return out;
}

template <typename Vector, int kComponents>
std::vector<Vector> Take(const DracoAttribute& attribute, uint32_t points) {
  std::vector<Vector> out(points);
  for (uint32_t i = 0; i < points; ++i) {
    const float* v = attribute.values.data() + size_t(i) * size_t(attribute.components);
    if constexpr (kComponents == 2) out[i] = {v[0], v[1]};
    if constexpr (kComponents == 3) out[i] = {v[0], v[1], v[2]};
    if constexpr (kComponents == 4) out[i] = {v[0], v[1], v[2], attribute.components == 4 ? v[3] : 1.0f};
  }
  return out;
}

// What does not fit is left out with a warning.
Primitive ToPrimitive(DracoMesh& mesh, WarningList& warnings) {
  Primitive primitive;
  primitive.triangles = mesh.triangles;
  for (DracoAttribute& attribute : mesh.attributes) {
    if (attribute.normalized) Normalize(attribute);
    if (attribute.kind == DracoAttribute::Kind::kPosition && attribute.components == 3 && primitive.positions.empty()) {
      primitive.positions = Take<Vec3f, 3>(attribute, mesh.points);
    } else if (attribute.kind == DracoAttribute::Kind::kNormal && attribute.components == 3 &&
               primitive.normals.empty()) {
      primitive.normals = Take<Vec3f, 3>(attribute, mesh.points);
    } else if (attribute.kind == DracoAttribute::Kind::kTexCoord && attribute.components == 2 &&
               primitive.uv[0].empty()) {
      primitive.uv[0] = Take<Vec2f, 2>(attribute, mesh.points);
    } else if (attribute.kind == DracoAttribute::Kind::kColor && attribute.components >= 3 &&
               primitive.colors.empty()) {
      primitive.colors = Take<Vec4f, 4>(attribute, mesh.points);
    } else if (attribute.kind == DracoAttribute::Kind::kOther && !attribute.name.empty() &&
               std::none_of(primitive.attributes.begin(), primitive.attributes.end(),
                            [&](const VertexAttribute& known) { return known.name == attribute.name; })) {
      primitive.attributes.push_back({attribute.name, attribute.components, std::move(attribute.values)});
    } else if (attribute.kind != DracoAttribute::Kind::kOther || !attribute.name.empty()) {
      warnings.Add(WarningCode::kNonconformingFile, absl::StrCat("attribute ", attribute.unique_id),
                   absl::StrCat("has ", attribute.components, " components or comes a second time; it is ignored"));
    }
  }
  return primitive;
}

}  // namespace

void Normalize(DracoAttribute& attribute) {
  if (attribute.integer_most == 0) return;
  for (float& value : attribute.values) {
    const float scaled = static_cast<float>(static_cast<double>(value) / attribute.integer_most);
    value = scaled < -1.0f ? -1.0f : scaled;
  }
}

absl::StatusOr<DracoMesh> DecodeDraco(std::span<const uint8_t> bytes, const LoadLimits& limits) {
  if (absl::Status s = CheckForeignDecoders(); !s.ok()) return s;
  try {
    UseBoundedOrientations();
    const auto counts = ReadDeclaredCounts(bytes);
    if (!counts.ok()) return counts.status();
    if (absl::Status s = CheckCounts(*counts, bytes.size(), limits); !s.ok()) return s;
    return Decode(bytes, counts->is_mesh, limits);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("draco: out of memory while decoding");
  } catch (const std::exception& e) {
    return Invalid(absl::StrCat("the decoder failed: ", e.what()));
  }
}

absl::StatusOr<Scene> LoadDraco(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  if (absl::Status over = job.Check(); !over.ok()) return over;
  auto mesh = DecodeDraco(bytes, limits);
  if (!mesh.ok()) return mesh.status();
  if (absl::Status over = job.Check(); !over.ok()) return over;
  Scene scene;
  scene.format = "drc";
  scene.nodes.emplace_back();
  scene.roots = {0};
  if (mesh->triangles.empty()) {
    scene.warnings.Add(WarningCode::kNoTriangles, "", "the Draco stream has no faces: there is nothing to voxelize");
    return scene;
  }
  Primitive primitive = ToPrimitive(*mesh, scene.warnings);
  if (primitive.positions.empty()) return Invalid("the mesh has no attribute POSITION of 3 components");
  scene.nodes[0].mesh = 0;
  scene.meshes.push_back(Mesh{"", {std::move(primitive)}});
  return scene;
}

}  // namespace voxelpipe
