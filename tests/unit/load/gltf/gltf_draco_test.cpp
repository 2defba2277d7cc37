// Attributes of Draco-compressed glTF primitives: the same values as those of a plain file. Streams are made with
// Draco's own encoder.
#include <draco/compression/expert_encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

#include <cstring>
#include <map>
#include <memory>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/decode/draco.h"
#include "load/gltf/geometry/gltf_draco.h"
#include "load/load_job.h"
#include "load/loader.h"
#include "support/meshes/glb_builder.h"
#include "support/warnings.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;
using namespace testing;
using nlohmann::json;

constexpr int kSide = 4;  // vertices along an edge of the patch

draco::DataType DracoType(int component_type) {
  switch (component_type) {
    case kI8: return draco::DT_INT8;
    case kU8: return draco::DT_UINT8;
    case kI16: return draco::DT_INT16;
    case kU16: return draco::DT_UINT16;
    case kU32: return draco::DT_UINT32;
    default: return draco::DT_FLOAT32;
  }
}

// An attribute of the patch as glTF declares it; `values` are those of the component type, vertex after vertex.
struct Column {
  std::string name;
  draco::GeometryAttribute::Type type;
  int component_type, components;
  bool normalized;
  std::vector<double> values;
};

void AppendComponent(ByteVector& bytes, int component_type, double value) {
  const auto put = [&](auto v) {
    uint8_t raw[sizeof v];
    std::memcpy(raw, &v, sizeof v);
    bytes.insert(bytes.end(), raw, raw + sizeof v);
  };
  switch (component_type) {
    case kI8: return put(int8_t(value));
    case kU8: return put(uint8_t(value));
    case kI16: return put(int16_t(value));
    case kU16: return put(uint16_t(value));
    case kU32: return put(uint32_t(value));
    default: return put(float(value));
  }
}

// The bytes of one vertex's value.
ByteVector Element(const Column& column, int vertex) {
  ByteVector bytes;
  for (int c = 0; c < column.components; ++c) {
    AppendComponent(bytes, column.component_type, column.values[size_t(vertex * column.components + c)]);
  }
  return bytes;
}

std::vector<uint32_t> PatchIndices() {
  std::vector<uint32_t> indices;
  for (uint32_t y = 0; y + 1 < kSide; ++y) {
    for (uint32_t x = 0; x + 1 < kSide; ++x) {
      const uint32_t v = y * kSide + x;
      indices.insert(indices.end(), {v, v + 1, v + kSide, v + 1, v + kSide + 1, v + kSide});
    }
  }
  return indices;
}

// A patch whose every attribute has values of its own at each vertex.
std::vector<Column> PatchColumns() {
  using Attribute = draco::GeometryAttribute;
  std::vector<Column> columns = {
      {"POSITION", Attribute::POSITION, kF32, 3, false, {}},   {"NORMAL", Attribute::NORMAL, kF32, 3, false, {}},
      {"TANGENT", Attribute::GENERIC, kF32, 4, false, {}},     {"TEXCOORD_0", Attribute::TEX_COORD, kF32, 2, false, {}},
      {"TEXCOORD_1", Attribute::TEX_COORD, kU16, 2, true, {}}, {"COLOR_0", Attribute::COLOR, kU8, 4, true, {}},
      {"JOINTS_0", Attribute::GENERIC, kU8, 4, false, {}},     {"WEIGHTS_0", Attribute::GENERIC, kU8, 4, true, {}},
      {"JOINTS_1", Attribute::GENERIC, kU16, 4, false, {}},    {"WEIGHTS_1", Attribute::GENERIC, kF32, 4, false, {}},
      {"_TEMP", Attribute::GENERIC, kF32, 1, false, {}},       {"_ID", Attribute::GENERIC, kU16, 1, false, {}},
      {"_FLOW", Attribute::GENERIC, kI16, 3, true, {}},        {"_SIGN", Attribute::GENERIC, kI8, 2, true, {}},
  };
  for (size_t k = 0; k < columns.size(); ++k) {
    Column& column = columns[k];
    for (int v = 0; v < kSide * kSide; ++v) {
      for (int c = 0; c < column.components; ++c) {
        double value = 1 + int(k) + 3 * v + c;
        if (column.name == "POSITION") value = c == 0 ? v % kSide : c == 1 ? v / kSide : 0.25 * (v % 3);
        if (column.name == "_FLOW") value = -32768 + 4000 * v + c;
        if (column.name == "_SIGN") value = -128 + 16 * v + c;
        if (column.component_type == kF32 && column.name != "POSITION") value = value / 64 - 0.25;
        column.values.push_back(value);
      }
    }
  }
  return columns;
}

// A stream of these columns; the attribute of column k has the unique id 20 + k.
ByteVector Encode(const std::vector<Column>& columns, bool sequential) {
  const std::vector<uint32_t> indices = PatchIndices();
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(int(indices.size() / 3));
  for (size_t k = 0; k < columns.size(); ++k) {
    const int id =
        builder.AddAttribute(columns[k].type, int8_t(columns[k].components), DracoType(columns[k].component_type));
    for (size_t f = 0; f < indices.size() / 3; ++f) {
      ByteVector corner[3];
      for (size_t i = 0; i < 3; ++i) corner[i] = Element(columns[k], int(indices[3 * f + i]));
      builder.SetAttributeValuesForFace(id, draco::FaceIndex(uint32_t(f)), corner[0].data(), corner[1].data(),
                                        corner[2].data());
    }
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  for (size_t k = 0; k < columns.size(); ++k) mesh->attribute(int(k))->set_unique_id(uint32_t(20 + k));
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetEncodingMethod(sequential ? draco::MESH_SEQUENTIAL_ENCODING : draco::MESH_EDGEBREAKER_ENCODING);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
  return {buffer.data(), buffer.data() + buffer.size()};
}

const char* TypeName(int components) {
  constexpr const char* kNames[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
  return kNames[components - 1];
}

// A GLB of the patch; `stream` compresses it.
GlbBuilder PatchGlb(const std::vector<Column>& columns, const std::optional<ByteVector>& stream) {
  GlbBuilder glb;
  json primitive = {{"attributes", json::object()}};
  json ids;
  for (size_t k = 0; k < columns.size(); ++k) {
    const Column& column = columns[k];
    ByteVector bytes;
    for (int v = 0; v < kSide * kSide; ++v) {
      const ByteVector element = Element(column, v);
      bytes.insert(bytes.end(), element.begin(), element.end());
    }
    const int view = stream ? -1 : glb.View(bytes);
    primitive["attributes"][column.name] =
        glb.Accessor(view, column.component_type, TypeName(column.components), kSide * kSide, column.normalized);
    ids[column.name] = 20 + k;
  }
  if (stream) {
    primitive["indices"] = glb.Accessor(-1, kU32, "SCALAR", PatchIndices().size());
    primitive["extensions"]["KHR_draco_mesh_compression"] = {{"bufferView", glb.View(*stream)}, {"attributes", ids}};
  } else {
    primitive["indices"] = glb.Indices(PatchIndices());
  }
  glb.Scene({glb.Node({{"mesh", glb.Mesh(primitive)}})});
  return glb;
}

Primitive Load(const GlbBuilder& glb) {
  absl::StatusOr<Scene> scene = LoadScene(glb.Glb());
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok()) return {};
  EXPECT_THAT(testing::Lines(scene->warnings), ::testing::IsEmpty());
  return std::move(scene->meshes.at(0).primitives.at(0));
}

const VertexAttribute& Own(const Primitive& primitive, const std::string& name) {
  for (const VertexAttribute& attribute : primitive.attributes) {
    if (attribute.name == name) return attribute;
  }
  ADD_FAILURE() << "no attribute " << name;
  static const VertexAttribute none;
  return none;
}

class GltfDraco : public ::testing::TestWithParam<bool> {};

TEST_P(GltfDraco, EveryAttributeHasTheValuesOfThePlainFile) {
  const std::vector<Column> columns = PatchColumns();
  const Primitive plain = Load(PatchGlb(columns, std::nullopt));
  const Primitive coded = Load(PatchGlb(columns, Encode(columns, GetParam())));
  ASSERT_EQ(plain.positions.size(), size_t{kSide * kSide});
  ASSERT_EQ(coded.positions.size(), plain.positions.size());
  EXPECT_EQ(coded.triangles.size(), plain.triangles.size());
  ASSERT_EQ(plain.attributes.size(), 4u);
  ASSERT_EQ(coded.attributes.size(), 4u);
  std::map<std::pair<float, float>, size_t> place;  // Draco may store vertices in another order
  for (size_t v = 0; v < plain.positions.size(); ++v) place[{plain.positions[v].x, plain.positions[v].y}] = v;
  for (size_t v = 0; v < coded.positions.size(); ++v) {
    const size_t w = place.at({coded.positions[v].x, coded.positions[v].y});
    EXPECT_EQ(coded.positions[v], plain.positions[w]);
    EXPECT_EQ(coded.normals.at(v), plain.normals.at(w));
    EXPECT_EQ(coded.tangents.at(v), plain.tangents.at(w));
    EXPECT_EQ(coded.colors.at(v), plain.colors.at(w));
    for (int set = 0; set < 2; ++set) {
      EXPECT_EQ(coded.uv[set].at(v), plain.uv[set].at(w)) << set;
      EXPECT_EQ(coded.joints[set].at(v), plain.joints[set].at(w)) << set;
      EXPECT_EQ(coded.weights[set].at(v), plain.weights[set].at(w)) << set;
    }
    for (const VertexAttribute& want : plain.attributes) {
      const VertexAttribute& got = Own(coded, want.name);
      ASSERT_EQ(got.components, want.components);
      for (int c = 0; c < want.components; ++c) {
        EXPECT_EQ(got.values.at(v * size_t(got.components) + size_t(c)),
                  want.values[w * size_t(got.components) + size_t(c)])
            << want.name << " " << v;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, GltfDraco, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "sequential" : "edgebreaker"; });

// Without this the test above could compare nothing but zeros.
TEST(GltfDracoValues, NormalizedIntegersAreFractions) {
  const std::vector<Column> columns = PatchColumns();
  const Primitive coded = Load(PatchGlb(columns, Encode(columns, true)));
  const auto first = std::find(coded.positions.begin(), coded.positions.end(), Vec3f{0, 0, 0});
  ASSERT_NE(first, coded.positions.end());
  const size_t v = size_t(first - coded.positions.begin());
  EXPECT_EQ(coded.weights[0][v][3], 11 / 255.0f);
  EXPECT_EQ(coded.joints[1][v][3], 12);
  EXPECT_EQ(coded.uv[1][v], (Vec2f{5 / 65535.0f, 6 / 65535.0f}));
  EXPECT_EQ(Own(coded, "_FLOW").values[3 * v], -1);
  EXPECT_EQ(Own(coded, "_SIGN").values[2 * v], -1);
  EXPECT_EQ(Own(coded, "_ID").values[v], 12);
}

TEST(GltfDracoValues, AnAttributeThatTheStreamLacksIsNamed) {
  const std::vector<Column> columns = PatchColumns();
  GlbBuilder glb = PatchGlb(columns, Encode(columns, true));
  glb.doc["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"]["_TEMP"] = 77;
  const absl::Status status = LoadScene(glb.Glb()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("_TEMP names the Draco attribute 77"));
}

// The stream's triangles may name vertices that a plain accessor of positions does not have.
TEST(GltfDracoValues, PositionsBesideTheStreamMustHaveItsVertices) {
  const std::vector<Column> columns = {PatchColumns()[0], PatchColumns()[1]};
  GlbBuilder glb = PatchGlb(columns, Encode(columns, true));
  json& primitive = glb.doc["meshes"][0]["primitives"][0];
  primitive["extensions"]["KHR_draco_mesh_compression"]["attributes"].erase("POSITION");
  EXPECT_TRUE(LoadScene(glb.Glb()).ok());
  for (json& accessor : glb.doc["accessors"]) {
    if (accessor["type"] == "VEC3") accessor["count"] = kSide * kSide - 1;
  }
  const absl::Status status = LoadScene(glb.Glb()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("mesh 0, primitive 0, the Draco stream: index 15 at position"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("there are 15 vertices"));
}

// In a plain .drc file, names are metadata.
TEST(DracoFile, StreamsEndWithTheirJob) {
  const ByteVector stream = Encode(PatchColumns(), false);
  const LoadLimits limits;
  JobContext job;
  gltf::DracoAhead ahead(job, {stream, stream}, limits);
  EXPECT_TRUE(ahead.Take(stream).ok());
  job.Cancel();
  EXPECT_EQ(ahead.Take(stream).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(LoadSceneFor(job, stream).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(gltf::DracoAhead(job, {stream}, limits).Take(stream).status().code(), absl::StatusCode::kCancelled);
}

TEST(DracoFile, GenericAttributesWithANameAreKept) {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(1);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int heat = builder.AddAttribute(draco::GeometryAttribute::GENERIC, 1, draco::DT_UINT8);
  const int other = builder.AddAttribute(draco::GeometryAttribute::GENERIC, 1, draco::DT_UINT8);
  const float p[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const uint8_t values[3] = {7, 7, 7};
  builder.SetAttributeValuesForFace(position, draco::FaceIndex(0), p[0], p[1], p[2]);
  builder.SetAttributeValuesForFace(heat, draco::FaceIndex(0), &values[0], &values[1], &values[2]);
  builder.SetAttributeValuesForFace(other, draco::FaceIndex(0), &values[0], &values[1], &values[2]);
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  auto name = std::make_unique<draco::AttributeMetadata>();
  name->AddEntryString("name", "heat");
  mesh->AddAttributeMetadata(heat, std::move(name));
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetEncodingMethod(draco::MESH_SEQUENTIAL_ENCODING);
  draco::EncoderBuffer buffer;
  ASSERT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
  const auto scene = LoadScene({reinterpret_cast<const uint8_t*>(buffer.data()), buffer.size()});
  ASSERT_TRUE(scene.ok()) << scene.status();
  const std::vector<VertexAttribute>& own = scene->meshes.at(0).primitives.at(0).attributes;
  ASSERT_EQ(own.size(), 1u);
  EXPECT_EQ(own[0].name, "heat");
  EXPECT_THAT(own[0].values, ::testing::ElementsAre(7, 7, 7));
}

}  // namespace
}  // namespace voxelpipe
