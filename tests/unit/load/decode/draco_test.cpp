// Streams are made with Draco's own encoder.
#include "load/decode/draco.h"

#include <draco/compression/encode.h>
#include <draco/compression/expert_encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

#include <algorithm>
#include <chrono>
#include <span>

#include "base/limit_error.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;
using namespace testing;

// A strip of `faces` triangles with normals and 8-bit colours.
std::vector<uint8_t> Encode(int faces, bool sequential) {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(faces);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int normal = builder.AddAttribute(draco::GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
  const int color = builder.AddAttribute(draco::GeometryAttribute::COLOR, 4, draco::DT_UINT8);
  for (int f = 0; f < faces; ++f) {
    float p[3][3];
    const float n[3] = {0, 0, 1};
    const uint8_t c[4] = {255, 51, 0, 255};
    for (int i = 0; i < 3; ++i) {
      const int k = f % 2 == 0 || i == 0 ? i : 3 - i;  // every other triangle of a strip is turned
      p[i][0] = float((f + k) / 2);
      p[i][1] = float((f + k) % 2);
      p[i][2] = 0;
    }
    builder.SetAttributeValuesForFace(position, draco::FaceIndex(f), p[0], p[1], p[2]);
    builder.SetAttributeValuesForFace(normal, draco::FaceIndex(f), n, n, n);
    builder.SetAttributeValuesForFace(color, draco::FaceIndex(f), c, c, c);
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetEncodingMethod(sequential ? draco::MESH_SEQUENTIAL_ENCODING : draco::MESH_EDGEBREAKER_ENCODING);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
  return {buffer.data(), buffer.data() + buffer.size()};
}

class DracoTest : public ::testing::TestWithParam<bool> {};

TEST_P(DracoTest, DecodesWhatWasEncoded) {
  const std::vector<uint8_t> bytes = Encode(20, GetParam());
  auto mesh = DecodeDraco({}, bytes, {});
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ(mesh->triangles.size(), 20u);
  EXPECT_EQ(mesh->points, 22u);
  ASSERT_EQ(mesh->attributes.size(), 3u);
  EXPECT_EQ(mesh->attributes[0].values.size(), 66u);
  EXPECT_EQ(mesh->attributes[2].kind, DracoAttribute::Kind::kColor);
  EXPECT_TRUE(mesh->attributes[2].normalized);
  EXPECT_EQ(mesh->attributes[2].values[1], 51);
  Normalize(mesh->attributes[2]);
  EXPECT_EQ(mesh->attributes[2].values[1], 0.2f);
}

TEST_P(DracoTest, LoadsAsASceneOfOneNode) {
  const auto scene = LoadScene(Encode(7, GetParam()));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->format, "drc");
  const auto mesh = Flatten(*scene);
  ASSERT_TRUE(mesh.ok());
  EXPECT_EQ(mesh->triangles.size(), 7u);
  EXPECT_EQ(mesh->normals[0], (Vec3f{0, 0, 1}));
}

TEST_P(DracoTest, TruncatedAtEveryLengthIsRefused) {
  const std::vector<uint8_t> bytes = Encode(12, GetParam());
  for (size_t n = 0; n < bytes.size(); ++n) {
    EXPECT_FALSE(DecodeDraco({}, std::span(bytes).first(n), {}).ok()) << n;
  }
}

TEST_P(DracoTest, FlippedBitsNeverCrash) {
  const std::vector<uint8_t> bytes = Encode(12, GetParam());
  int refused = 0;
  for (size_t bit = 0; bit < bytes.size() * 8; ++bit) {
    std::vector<uint8_t> flipped = bytes;
    flipped[bit / 8] ^= uint8_t(1 << (bit % 8));
    const auto mesh = DecodeDraco({}, flipped, {});
    if (!mesh.ok()) {
      ++refused;
      continue;
    }
    for (const auto& t : mesh->triangles) {
      for (const uint32_t v : t) ASSERT_LT(v, mesh->points);
    }
  }
  EXPECT_GT(refused, 0);
}

TEST_P(DracoTest, LimitsAreNamed) {
  LoadLimits limits;
  limits.max_triangles = 11;
  EXPECT_EQ(DecodeDraco({}, Encode(12, GetParam()), limits).status().code(), absl::StatusCode::kResourceExhausted);
}

INSTANTIATE_TEST_SUITE_P(Methods, DracoTest, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "sequential" : "edgebreaker"; });

// Version 2.2, sequential: eleven header bytes, then faces and points as varints.
TEST(DracoBombTest, DeclaredCountsBeyondTheBytesAreRefusedBeforeDecoding) {
  std::vector<uint8_t> bomb = {'D',  'R',  'A',  'C',  'O',  2,    2,    1,    0,    0,   0,
                               0xff, 0xff, 0xff, 0xff, 0x0f, 0xff, 0xff, 0xff, 0xff, 0x0f};
  const auto mesh = DecodeDraco({}, bomb, {});
  EXPECT_EQ(mesh.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(mesh.status().message()), HasSubstr("4294967295 faces"));
  bomb[5] = 9;
  EXPECT_THAT(std::string(DecodeDraco({}, bomb, {}).status().message()), HasSubstr("version 9.2"));
}

// A fan of triangles with texture coordinates, whose prediction stores how many orientations follow.
std::vector<uint8_t> EncodeTextured() {
  constexpr int kFaces = 60;
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(kFaces);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int uv = builder.AddAttribute(draco::GeometryAttribute::TEX_COORD, 2, draco::DT_FLOAT32);
  for (int f = 0; f < kFaces; ++f) {
    float p[3][3], t[3][2];
    for (int i = 0; i < 3; ++i) {
      const int k = f % 2 == 0 || i == 0 ? i : 3 - i;
      const float x = float((f + k) / 2), y = float((f + k) % 2);
      p[i][0] = x + 0.1f * y;
      p[i][1] = y * (1 + 0.3f * float((f + k) % 5));
      p[i][2] = 0.01f * x * x;
      t[i][0] = 0.013f * x + 0.3f * y;
      t[i][1] = 0.7f * y + 0.002f * x * x;
    }
    builder.SetAttributeValuesForFace(position, draco::FaceIndex(f), p[0], p[1], p[2]);
    builder.SetAttributeValuesForFace(uv, draco::FaceIndex(f), t[0], t[1], t[2]);
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(0, 0);
  encoder.SetAttributeQuantization(position, 14);
  encoder.SetAttributeQuantization(uv, 12);
  EXPECT_TRUE(encoder.SetAttributePredictionScheme(uv, draco::MESH_PREDICTION_TEX_COORDS_PORTABLE).ok());
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
  return {buffer.data(), buffer.data() + buffer.size()};
}

// The position of the count in the stream is unknown: one of those tried is right, and a library that does not check it
// takes 10 s there.
TEST(DracoBombTest, TheCountOfOrientationsIsNotBelieved) {
  const std::vector<uint8_t> good = EncodeTextured();
  ASSERT_TRUE(DecodeDraco({}, good, {}).ok());
  for (size_t at = 11; at + 4 <= good.size(); ++at) {
    if (good[at + 1] != 0 || good[at + 2] != 0 || good[at + 3] != 0) continue;  // of the small count's four bytes
    std::vector<uint8_t> bomb = good;
    bomb[at] = bomb[at + 1] = bomb[at + 2] = 0xff;
    bomb[at + 3] = 0x7f;
    const auto begin = std::chrono::steady_clock::now();
    (void)DecodeDraco({}, bomb, {});
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(2)) << "byte " << at;
  }
}

// Attributes of a constant value take hardly any bytes, whatever the number of points.
TEST(DracoBombTest, PointsTimesAttributesAreBoundedBeforeTheyAreDecoded) {
  constexpr int kFaces = 40'000, kAttributes = 30;
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(kFaces);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  std::vector<int> constant;
  for (int i = 0; i < kAttributes; ++i) {
    constant.push_back(builder.AddAttribute(draco::GeometryAttribute::GENERIC, 4, draco::DT_UINT8));
  }
  const uint8_t same[4] = {1, 2, 3, 4};
  for (int f = 0; f < kFaces; ++f) {
    float p[3][3];
    for (int i = 0; i < 3; ++i) {
      const int k = f % 2 == 0 || i == 0 ? i : 3 - i;
      p[i][0] = float((f + k) / 2);
      p[i][1] = float((f + k) % 2);
      p[i][2] = 0;
    }
    builder.SetAttributeValuesForFace(position, draco::FaceIndex(f), p[0], p[1], p[2]);
    for (const int id : constant) builder.SetAttributeValuesForFace(id, draco::FaceIndex(f), same, same, same);
  }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::ExpertEncoder encoder(*mesh);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetAttributeQuantization(position, 8);
  draco::EncoderBuffer buffer;
  ASSERT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
  const std::span<const uint8_t> bytes(reinterpret_cast<const uint8_t*>(buffer.data()), buffer.size());
  const uint64_t values = uint64_t{mesh->num_points()} * (3 + 4 * kAttributes);
  ASSERT_GT(values, bytes.size() * LoadLimits().max_draco_values_per_byte) << bytes.size();
  const absl::Status status = DecodeDraco({}, bytes, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_TRUE(LimitErrorOf(status).has_value());
  MemoryBudget little(8 << 20);
  JobContext job;
  job.set_memory(&little);
  LoadLimits ample;
  ample.max_draco_values_per_byte = 1 << 20;
  EXPECT_EQ(DecodeDraco(job, bytes, ample).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(little.used_bytes(), 0u);
  EXPECT_TRUE(DecodeDraco({}, bytes, ample).ok());
}

// A flat grid of n x n points with three floats each, and further attributes: bytes of a constant value, or the grid's
// own floats again.
std::vector<uint8_t> EncodeGrid(int n, int constants, int copies) {
  draco::Mesh mesh;
  mesh.SetNumFaces(size_t(2 * (n - 1) * (n - 1)));
  mesh.set_num_points(uint32_t(n * n));
  draco::FaceIndex face(0);
  for (int y = 0; y + 1 < n; ++y) {
    for (int x = 0; x + 1 < n; ++x) {
      const draco::PointIndex a(uint32_t(y * n + x)), c(uint32_t((y + 1) * n + x));
      mesh.SetFace(face++, {a, a + 1, c});
      mesh.SetFace(face++, {a + 1, c + 1, c});
    }
  }
  const auto add = [&](draco::GeometryAttribute::Type type, int components, draco::DataType of) {
    draco::GeometryAttribute attribute;
    const int64_t stride = draco::DataTypeLength(of) * components;
    attribute.Init(type, nullptr, uint8_t(components), of, false, stride, 0);
    return mesh.attribute(mesh.AddAttribute(attribute, true, uint32_t(n * n)));
  };
  for (int i = 0; i <= copies; ++i) {
    using Attribute = draco::GeometryAttribute;
    draco::PointAttribute* const floats = add(i == 0 ? Attribute::POSITION : Attribute::GENERIC, 3, draco::DT_FLOAT32);
    for (int p = 0; p < n * n; ++p) {
      const float value[3] = {float(p % n), float(p / n), 0};
      floats->SetAttributeValue(draco::AttributeValueIndex(uint32_t(p)), value);
    }
  }
  for (int i = 0; i < constants; ++i) {
    draco::PointAttribute* const bytes = add(draco::GeometryAttribute::GENERIC, 1, draco::DT_UINT8);
    const uint8_t value = 7;
    for (int p = 0; p < n * n; ++p) bytes->SetAttributeValue(draco::AttributeValueIndex(uint32_t(p)), &value);
  }
  draco::ExpertEncoder encoder(mesh);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(0, 0);
  for (int i = 0; i <= copies; ++i) encoder.SetAttributeQuantization(i, 11);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
  return {buffer.data(), buffer.data() + buffer.size()};
}

// 237 KB made a decoder of connectivity take 12 s and 4 GB: a set of attributes without seams takes hardly any bytes.
TEST(DracoBombTest, SetsOfAttributesAreBoundedBeforeConnectivityIsDecoded) {
  std::vector<uint8_t> bomb = EncodeGrid(200, 60, 0);
  for (const bool readable : {true, false}) {
    if (!readable) std::fill(bomb.begin() + 24, bomb.end(), uint8_t{0});  // behind the counts
    const absl::Status status = DecodeDraco({}, bomb, {}).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_TRUE(LimitErrorOf(status).has_value());
    EXPECT_THAT(std::string(status.message()), HasSubstr("79202 faces for the positions and in each of 60 sets"));
    EXPECT_THAT(std::string(status.message()), HasSubstr("max_draco_values_per_byte"));
  }
}

TEST(DracoBombTest, AFlatGridWithAFewAttributesIsNone) {
  const auto mesh = DecodeDraco({}, EncodeGrid(300, 2, 2), {});
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ(mesh->triangles.size(), 2u * 299 * 299);
  EXPECT_EQ(mesh->attributes.size(), 5u);
}

TEST(DracoHeaderTest, AnUnknownGeometryTypeIsNoPointCloud) {
  const std::vector<uint8_t> bytes = {'D', 'R', 'A', 'C', 'O', 2, 2, 9, 0, 0, 0, 1, 0, 0, 0, 0};
  const absl::Status s = LoadDraco(JobContext(), bytes, {}).status();
  EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(s.message()), HasSubstr("geometry type 9 at byte 7"));
}

// A bool attribute's byte may be anything; Draco would load it as a bool, which sanitizers report.
TEST(DracoBoolTest, AttributesOfBoolsAreLeftOut) {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(1);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int flag = builder.AddAttribute(draco::GeometryAttribute::GENERIC, 1, draco::DT_BOOL);
  const float p[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const uint8_t flags[3] = {0, 1, 128};
  builder.SetAttributeValuesForFace(position, draco::FaceIndex(0), p[0], p[1], p[2]);
  builder.SetAttributeValuesForFace(flag, draco::FaceIndex(0), &flags[0], &flags[1], &flags[2]);
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  ASSERT_NE(mesh, nullptr);
  draco::Encoder encoder;
  encoder.SetEncodingMethod(draco::MESH_SEQUENTIAL_ENCODING);
  draco::EncoderBuffer out;
  ASSERT_TRUE(encoder.EncodeMeshToBuffer(*mesh, &out).ok());
  const auto decoded = DecodeDraco({}, {reinterpret_cast<const uint8_t*>(out.data()), out.size()}, {});
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(decoded->triangles.size(), 1u);
  ASSERT_EQ(decoded->attributes.size(), 1u);
  EXPECT_EQ(decoded->attributes[0].kind, DracoAttribute::Kind::kPosition);
}

// A glTF mesh of one primitive a stream, strips of 1, 2, 3... triangles.
ByteVector GlbOfStrips(int primitives, const std::vector<int>& broken) {
  GlbBuilder glb;
  nlohmann::json list = nlohmann::json::array();
  for (int i = 0; i < primitives; ++i) {
    const int faces = i + 1;
    std::vector<uint8_t> stream = Encode(faces, false);
    if (std::find(broken.begin(), broken.end(), i) != broken.end()) stream.resize(stream.size() / 2);
    const int view = glb.View(stream);
    const int first = int(glb.doc["accessors"].size());
    glb.doc["accessors"].push_back({{"componentType", kF32}, {"type", "VEC3"}, {"count", faces + 2}});
    glb.doc["accessors"].push_back({{"componentType", kU32}, {"type", "SCALAR"}, {"count", 3 * faces}});
    list.push_back(
        {{"attributes", {{"POSITION", first}}},
         {"indices", first + 1},
         {"extensions", {{"KHR_draco_mesh_compression", {{"bufferView", view}, {"attributes", {{"POSITION", 0}}}}}}}});
  }
  glb.doc["meshes"].push_back({{"primitives", list}});
  glb.Node({{"mesh", 0}});
  glb.Scene({0});
  return glb.Glb();
}

// More streams than are decoded at once.
TEST(DracoGltf, StreamsDecodedTogetherKeepTheirPrimitives) {
  const auto scene = LoadScene(GlbOfStrips(150, {}));
  ASSERT_TRUE(scene.ok()) << scene.status();
  const std::vector<Primitive>& primitives = scene->meshes.at(0).primitives;
  ASSERT_EQ(primitives.size(), 150u);
  for (size_t i = 0; i < primitives.size(); ++i) {
    EXPECT_EQ(primitives[i].triangles.size(), i + 1);
    EXPECT_EQ(primitives[i].positions.size(), i + 3);
  }
}

TEST(DracoGltf, TheFirstBrokenStreamIsNamed) {
  for (int run = 0; run < 5; ++run) {
    const absl::Status s = LoadScene(GlbOfStrips(20, {6, 3, 17})).status();
    EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(s.message()), HasSubstr("mesh 0, primitive 3, bufferView 3"));
  }
}

}  // namespace
}  // namespace voxelpipe
