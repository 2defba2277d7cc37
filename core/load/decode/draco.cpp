// Source: Draco bitstream specification 2.2 (Google, 2018), sections on the header, metadata and connectivity.
#include "load/decode/draco.h"

#include <draco/attributes/point_attribute.h>
#include <draco/compression/config/decoder_options.h>
#include <draco/compression/mesh/mesh_edgebreaker_decoder.h>
#include <draco/compression/mesh/mesh_sequential_decoder.h>
#include <draco/compression/point_cloud/point_cloud_decoder.h>
#include <draco/core/varint_decoding.h>
#include <draco/metadata/metadata_decoder.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "base/long_loops.h"
#include "load/decode/draco_orientations.h"
#include "load/decode/foreign_decoders.h"

namespace voxelpipe {
namespace {

// Bytes of the decoder itself: corner tables and traversal, per face (three corners) and per point; and per point and
// attribute the index in the table of values.
constexpr uint64_t kBytesOfFace = 80, kBytesOfPoint = 40, kBytesOfIndex = 4;
// Further bytes of each set of attributes with connectivity of its own: per face the vertices and seams of its corners;
// per point the index of its value, the inverse of that, a corner and seams.
constexpr uint64_t kSetBytesOfFace = 13, kSetBytesOfPoint = 17;
constexpr uint32_t kStep = 1 << 18;  // faces or points between two polls of the job
// Quantized and integer values are decoded to this type and kept until all attributes are decoded.
constexpr uint64_t kPortableBytes = 4;
constexpr uint64_t kMinFaces = 65'536, kMinValues = 1 << 20;  // that every stream may have, in all sets

struct DeclaredCounts {
  uint64_t faces = 0, points = 0;
  uint64_t attribute_sets = 0;  // with connectivity of their own
  bool is_mesh = false;
  bool sequential = false;
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

// The counts that the stream's connectivity declares, read before the decoder allocates for it.
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
    counts.sequential = header.encoder_method == draco::MESH_SEQUENTIAL_ENCODING;
    if (header.encoder_method == draco::MESH_SEQUENTIAL_ENCODING) {
      const bool fixed = version < DRACO_BITSTREAM_VERSION(2, 2);
      ok = ReadCount(buffer, fixed, counts.faces) && ReadCount(buffer, fixed, counts.points);
    } else {
      const bool fixed = version < DRACO_BITSTREAM_VERSION(2, 0);
      uint8_t traversal = 0;
      uint64_t new_vertices = 0;
      ok = buffer.Decode(&traversal);
      if (version < DRACO_BITSTREAM_VERSION(2, 2)) ok = ok && ReadCount(buffer, fixed, new_vertices);
      uint8_t sets = 0;
      ok = ok && ReadCount(buffer, fixed, counts.points) && ReadCount(buffer, fixed, counts.faces) &&
           buffer.Decode(&sets);
      counts.attribute_sets = sets;
    }
  } else if (header.encoder_type == draco::POINT_CLOUD) {
    ok = ReadCount(buffer, true, counts.points);
  } else {
    return Invalid(absl::StrCat("unknown geometry type ", int(header.encoder_type), " at byte 7"));
  }
  if (!ok) return Invalid(absl::StrCat("the stream of ", bytes.size(), " bytes ends before its element counts"));
  return counts;
}

// Every set takes time and memory for each face, but its connectivity takes hardly any bytes where it has no seams. A
// flat grid of a million points with five attributes has 105 faces in sets a byte, and 168 values.
absl::Status CheckSets(const DeclaredCounts& counts, uint64_t bytes, const LoadLimits& limits) {
  const uint64_t faces = counts.faces * (1 + counts.attribute_sets);
  const uint64_t most = std::max(kMinFaces, bytes * limits.max_draco_values_per_byte / 2);
  if (faces <= most) return absl::OkStatus();
  constexpr uint64_t kFaceBytes = kSetBytesOfFace + kSetBytesOfPoint / 2;  // there are half as many points
  return MakeLimitError(absl::StrCat("draco: ", counts.faces, " faces for the positions and in each of ",
                                     counts.attribute_sets, " sets of attributes make ", faces, " of ", bytes,
                                     " bytes; the limit, half of max_draco_values_per_byte, allows ", most),
                        {faces * kFaceBytes, most * kFaceBytes, 0});
}

absl::Status CheckCounts(const DeclaredCounts& counts, uint64_t bytes, const LoadLimits& limits) {
  const uint64_t most = bytes * limits.max_elements_per_byte;
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
  return CheckSets(counts, bytes, limits);
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

// `attribute` is no longer normalized afterwards: Draco's own conversion does not clamp as glTF requires.
absl::StatusOr<DracoAttribute> ReadAttribute(const JobContext& job, draco::PointAttribute& attribute, uint32_t points) {
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
  if (absl::Status over = Resize(job, out.values, uint64_t(points) * uint64_t(out.components)); !over.ok()) return over;
  for (uint32_t i = 0; i < points; ++i) {
    if (i % kStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
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

// Bytes of the decoder for the values of all declared attributes, both as stored in the stream and as decoded. An
// attribute has at most one value a point.
uint64_t AttributeBytes(const draco::PointCloud& cloud) {
  uint64_t bytes = 0;
  for (int32_t i = 0; i < cloud.num_attributes(); ++i) {
    const draco::PointAttribute& attribute = *cloud.attribute(i);
    const uint64_t size = std::max(0, draco::DataTypeLength(attribute.data_type()));
    bytes += attribute.num_components() * (size + kPortableBytes) + kBytesOfIndex;
  }
  return bytes * cloud.num_points();
}

// Draco's decoder, charging the job's memory before each of its large steps and polling the job between them.
template <typename Base>
class GuardedDecoder final : public Base {
 public:
  GuardedDecoder(const JobContext& job, const LoadLimits& limits, const DeclaredCounts& counts, uint64_t stream_bytes)
      : job_(job), limits_(limits), counts_(counts), stream_bytes_(stream_bytes), charge_(&MemoryOf(job)) {}

  // Why a step did not start, if that is not the stream's fault.
  const absl::Status& refusal() const { return refusal_; }
  // The charge of the decoded mesh, which outlives the decoder.
  MemoryCharge TakeCharge() { return std::move(charge_); }

 protected:
  bool DecodeConnectivity() override {
    const uint64_t of_face = kBytesOfFace + counts_.attribute_sets * kSetBytesOfFace;
    const uint64_t of_point = kBytesOfPoint + counts_.attribute_sets * kSetBytesOfPoint;
    return Allow(charge_.Grow(counts_.faces * of_face + counts_.points * of_point, "draco: the connectivity")) &&
           Base::DecodeConnectivity();
  }

  bool DecodeAllAttributes() override {
    if (!Allow(CheckValues()) || !Allow(charge_.Grow(AttributeBytes(*this->point_cloud()), "draco: the attributes"))) {
      return false;
    }
    for (int32_t i = 0; i < this->num_attributes_decoders(); ++i) {
      // As the base class does with its own list, to which it gives only const access.
      auto* const decoder = const_cast<draco::AttributesDecoderInterface*>(this->attributes_decoder(i));
      if (!Allow(job_.Check()) || decoder == nullptr || !decoder->DecodeAttributes(this->buffer())) return false;
    }
    return Allow(job_.Check());
  }

 private:
  bool Allow(absl::Status status) {
    refusal_ = std::move(status);
    return refusal_.ok();
  }

  // Attributes of a constant value take no bytes at all, whatever the number of points.
  absl::Status CheckValues() const {
    const draco::PointCloud& cloud = *this->point_cloud();
    uint64_t components = 0;
    for (int32_t i = 0; i < cloud.num_attributes(); ++i) components += cloud.attribute(i)->num_components();
    const uint64_t values = components * cloud.num_points();
    const uint64_t most = std::max(kMinValues, stream_bytes_ * limits_.max_draco_values_per_byte);
    if (values <= most) return absl::OkStatus();
    return MakeLimitError(absl::StrCat("draco: ", cloud.num_attributes(), " attributes of ", components,
                                       " components and ", cloud.num_points(), " points make ", values, " values of ",
                                       stream_bytes_, " bytes; the limit max_draco_values_per_byte allows ", most),
                          {values * sizeof(float), most * sizeof(float), 0});
  }

  const JobContext& job_;
  const LoadLimits& limits_;
  const DeclaredCounts& counts_;
  const uint64_t stream_bytes_;
  MemoryCharge charge_;
  absl::Status refusal_;
};

struct DecodedStream {
  std::unique_ptr<draco::Mesh> mesh;
  MemoryCharge charge;
};

template <typename Base>
absl::StatusOr<DecodedStream> DecodeStream(const JobContext& job, std::span<const uint8_t> bytes,
                                           const LoadLimits& limits, const DeclaredCounts& counts) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  DecodedStream out{std::make_unique<draco::Mesh>(), {}};
  GuardedDecoder<Base> decoder(job, limits, counts, bytes.size());
  const draco::Status decoded = decoder.Decode(draco::DecoderOptions(), &buffer, out.mesh.get());
  if (!decoder.refusal().ok()) return decoder.refusal();
  if (!decoded.ok()) return Invalid(decoded.error_msg_string());
  out.charge = decoder.TakeCharge();
  return out;
}

absl::StatusOr<DracoMesh> Decode(const JobContext& job, std::span<const uint8_t> bytes, const DeclaredCounts& counts,
                                 const LoadLimits& limits) {
  DracoMesh out;
  if (!counts.is_mesh) return out;  // a point cloud has nothing to voxelize
  absl::StatusOr<DecodedStream> decoded = counts.sequential
                                              ? DecodeStream<draco::MeshSequentialDecoder>(job, bytes, limits, counts)
                                              : DecodeStream<draco::MeshEdgebreakerDecoder>(job, bytes, limits, counts);
  if (!decoded.ok()) return decoded.status();
  const std::unique_ptr<draco::Mesh> mesh = std::move(decoded->mesh);
  out.memory = MemoryCharge(&MemoryOf(job));
  if (mesh->num_faces() > limits.max_triangles || mesh->num_points() > limits.max_vertices) {
    return absl::ResourceExhaustedError(absl::StrCat("draco: ", mesh->num_faces(), " triangles and ",
                                                     mesh->num_points(), " vertices, the limits are ",
                                                     limits.max_triangles, " and ", limits.max_vertices));
  }
  out.points = mesh->num_points();
  if (absl::Status full = out.memory.Grow(mesh->num_faces(), sizeof(out.triangles[0]), "draco: the triangles");
      !full.ok()) {
    return full;
  }
  out.triangles.reserve(mesh->num_faces());
  for (draco::FaceIndex f(0); f < mesh->num_faces(); ++f) {
    if (f.value() % kStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    const draco::Mesh::Face& face = mesh->face(f);
    const std::array<uint32_t, 3> t{face[0].value(), face[1].value(), face[2].value()};
    for (const uint32_t v : t) {
      if (v >= out.points) return Invalid(absl::StrCat("face ", f.value(), " refers to point ", v, " of ", out.points));
    }
    out.triangles.push_back(t);
  }
  for (int32_t i = 0; i < mesh->num_attributes(); ++i) {
    draco::PointAttribute& attribute = *mesh->attribute(i);
    // Custom data with too many components for any shader. Draco's conversion of DT_BOOL loads an untrusted byte as a
    // bool, which is undefined.
    if (attribute.num_components() > 4 || attribute.data_type() == draco::DT_BOOL) continue;
    std::string name;
    if (const draco::AttributeMetadata* const metadata = mesh->GetAttributeMetadataByAttributeId(i)) {
      metadata->GetEntryString("name", &name);
    }
    if (absl::Status full =
            out.memory.Grow(uint64_t{out.points} * attribute.num_components(), sizeof(float), "draco: an attribute");
        !full.ok()) {
      return full;
    }
    auto read = ReadAttribute(job, attribute, out.points);
    if (!read.ok()) return read.status();
    read->name = std::move(name);
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

// Attributes that do not fit are left out with a warning.
Primitive ToPrimitive(DracoMesh& mesh, WarningList& warnings) {
  Primitive primitive;
  primitive.triangles = std::move(mesh.triangles);
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

absl::StatusOr<DracoMesh> DecodeDraco(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  if (absl::Status s = CheckForeignDecoders(); !s.ok()) return s;
  try {
    UseBoundedOrientations();
    const auto counts = ReadDeclaredCounts(bytes);
    if (!counts.ok()) return counts.status();
    if (absl::Status s = CheckCounts(*counts, bytes.size(), limits); !s.ok()) return s;
    return Decode(job, bytes, *counts, limits);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("draco: out of memory while decoding");
  } catch (const std::exception& e) {
    return Invalid(absl::StrCat("the decoder failed: ", e.what()));
  }
}

absl::StatusOr<Scene> LoadDraco(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  if (absl::Status over = job.Check(); !over.ok()) return over;
  auto mesh = DecodeDraco(job, bytes, limits);
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
  // The values of attributes once more, while they are moved.
  uint64_t values = 0;
  for (const DracoAttribute& attribute : mesh->attributes) values += attribute.values.size();
  if (absl::Status full = mesh->memory.Grow(values, sizeof(float), "draco: the primitive"); !full.ok()) return full;
  Primitive primitive = ToPrimitive(*mesh, scene.warnings);
  const uint64_t kept = primitive.triangles.size() * sizeof(primitive.triangles[0]) + values * sizeof(float);
  mesh->attributes.clear();
  mesh->memory.ShrinkTo(kept);
  scene.memory = std::make_shared<MemoryCharge>(std::move(mesh->memory));
  if (primitive.positions.empty()) return Invalid("the mesh has no attribute POSITION of 3 components");
  scene.nodes[0].mesh = 0;
  scene.meshes.push_back(Mesh{"", {std::move(primitive)}});
  return scene;
}

}  // namespace voxelpipe
