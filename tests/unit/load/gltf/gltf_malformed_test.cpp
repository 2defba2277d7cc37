// Files that are wrong: one clear error, no crash, no large allocation.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>

#include "base/limit_error.h"
#include "load/load_job.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using testing::ByteVector;
using testing::GlbBuilder;
using ::testing::HasSubstr;
using ::testing::Not;

// Accessor 0 = POSITION in view 0, accessor 1 = 6 indices in view 1, mesh 0, node 0, scene 0.
GlbBuilder Square() {
  GlbBuilder builder;
  const json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {0, 1, 2, 0, 2, 3});
  builder.Scene({builder.Node({{"mesh", builder.Mesh(primitive)}})});
  return builder;
}

// An error is one printable line.
void ExpectOneLine(const absl::Status& status) {
  const std::string message(status.message());
  EXPECT_FALSE(message.empty());
  EXPECT_LT(message.size(), 400u) << message;
  for (const char c : message) EXPECT_TRUE(c >= 32 && c < 127) << message;
}

absl::Status LoadStatus(const ByteVector& bytes) {
  const absl::Status status = LoadScene(bytes).status();
  if (!status.ok()) ExpectOneLine(status);
  return status;
}

struct Fault {
  const char* name;
  std::function<void(GlbBuilder&)> make;
  const char* says;
};

class Malformed : public ::testing::TestWithParam<Fault> {};

TEST_P(Malformed, IsRefusedByName) {
  GlbBuilder builder = Square();
  ASSERT_TRUE(LoadStatus(builder.Glb()).ok());
  GetParam().make(builder);
  const absl::Status status = LoadStatus(builder.Glb());
  EXPECT_FALSE(status.ok());
  EXPECT_THAT(std::string(status.message()), HasSubstr(GetParam().says));
}

json& At(GlbBuilder& builder, const char* pointer) {
  return builder.doc[json::json_pointer(pointer)];
}

// Sets one member of the document.
Fault Set(const char* name, const char* pointer, json value, const char* says) {
  return {name, [=](GlbBuilder& builder) { At(builder, pointer) = value; }, says};
}

void SetFloat(GlbBuilder& builder, size_t byte, float value) {
  std::memcpy(builder.bin.data() + byte, &value, 4);
}

const Fault kFaults[] = {
    Set("Version1", "/asset/version", "1.0", "asset.version '1.0'"),
    Set("VersionNumber", "/asset/version", 2.0, "asset: version is not a string"),
    Set("RequiredUnknown", "/extensionsRequired", {"ACME_gizmo"}, "'ACME_gizmo'"),
    Set("CountHuge", "/accessors/0/count", 4000000000u, "accessor 0: 4000000000 elements"),
    Set("CountWraps", "/accessors/0/count", std::numeric_limits<uint64_t>::max(), "accessor 0"),
    Set("CountNegative", "/accessors/0/count", -3, "accessor 0: count is not a non-negative integer"),
    Set("CountFraction", "/accessors/0/count", 3.5, "accessor 0: count"),
    Set("CountText", "/accessors/0/count", "4", "accessor 0: count"),
    Set("OffsetNegative", "/accessors/0/byteOffset", -4, "accessor 0: byteOffset"),
    Set("OffsetWraps", "/accessors/0/byteOffset", std::numeric_limits<uint64_t>::max() - 3, "accessor 0"),
    Set("OffsetPastEnd", "/accessors/0/byteOffset", 4, "accessor 0"),
    Set("StrideOverruns", "/bufferViews/0/byteStride", 252, "accessor 0"),
    Set("StrideWraps", "/bufferViews/0/byteStride", std::numeric_limits<uint64_t>::max(), "accessor 0"),
    Set("TypeUnknown", "/accessors/0/type", "VEC5", "accessor 0: type 'VEC5'"),
    Set("TypeVec2", "/accessors/0/type", "VEC2", "POSITION (accessor 0) has 2 components"),
    Set("ComponentUnknown", "/accessors/0/componentType", 5124, "accessor 0: componentType 5124"),
    Set("FloatIndices", "/accessors/1/componentType", 5126, "accessor 1: component type 5126"),
    Set("SignedIndices", "/accessors/1/componentType", 5120, "accessor 1"),
    Set("VectorIndices", "/accessors/1", {{"bufferView", 1}, {"componentType", 5125}, {"type", "VEC2"}, {"count", 3}},
        "accessor 1"),
    Set("AccessorDangling", "/meshes/0/primitives/0/attributes/POSITION", 9, "POSITION 9 is out of range"),
    Set("IndicesDangling", "/meshes/0/primitives/0/indices", 9, "indices 9 is out of range"),
    Set("ViewDangling", "/accessors/0/bufferView", 9, "accessor 0: bufferView 9"),
    Set("BufferDangling", "/bufferViews/0/buffer", 9, "bufferView 0: buffer 9"),
    Set("ViewPastBuffer", "/bufferViews/1/byteLength", 4096, "bufferView 1"),
    Set("ViewWraps", "/bufferViews/1/byteOffset", std::numeric_limits<uint64_t>::max(), "bufferView 1"),
    Set("ViewNoObject", "/bufferViews/1", 3, "bufferView 1: is not an object"),
    Set("Mode7", "/meshes/0/primitives/0/mode", 7, "mode 7"),
    Set("PrimitivesNoArray", "/meshes/0/primitives", 5, "mesh 0: primitives is not an array"),
    Set("NodeItsOwnChild", "/nodes/0/children", {0}, "node 0"),
    Set("NodeChildDangling", "/nodes/0/children", {5}, "node 0: children"),
    Set("NodeMeshDangling", "/nodes/0/mesh", 5, "node 0: mesh 5"),
    Set("NodeMatrixShort", "/nodes/0/matrix", {1, 0, 0}, "node 0: matrix has 3 numbers"),
    Set("NodeScaleText", "/nodes/0/scale", {1, "a", 1}, "node 0: scale"),
    Set("SceneDangling", "/scene", 3, "scene 3 is out of range"),
    Set("SceneText", "/scene", "hello", "scene is not"),
    Set("RootDangling", "/scenes/0/nodes", {8}, "scene 0: nodes"),
    Set("RootTwice", "/scenes/0/nodes", {0, 0}, "lists node 0 twice"),
    Set("SparseTooMany", "/accessors/0/sparse",
        {{"count", 5}, {"indices", {{"bufferView", 1}, {"componentType", 5121}}}, {"values", {{"bufferView", 0}}}},
        "accessor 0, sparse: count 5"),
    Set("SparseIndexPastEnd", "/accessors/0/sparse",
        {{"count", 1},
         {"indices", {{"bufferView", 1}, {"byteOffset", 20}, {"componentType", 5121}}},
         {"values", {{"bufferView", 0}, {"byteOffset", 40}}}},
        "accessor 0, sparse values"),
    Set("DracoViewDangling", "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression",
        {{"bufferView", 999}, {"attributes", {{"POSITION", 0}}}}, "bufferView 999"),
    Set("DracoGarbage", "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression",
        {{"bufferView", 0}, {"attributes", {{"POSITION", 0}}}}, "mesh 0, primitive 0, bufferView 0"),
    Set("MeshoptGarbage", "/bufferViews/0/extensions/EXT_meshopt_compression",
        {{"buffer", 0}, {"byteLength", 40}, {"byteStride", 12}, {"count", 4}, {"mode", "ATTRIBUTES"}}, "bufferView 0"),
    Set("MeshoptCountHuge", "/bufferViews/0/extensions/EXT_meshopt_compression",
        {{"buffer", 0}, {"byteLength", 40}, {"byteStride", 256}, {"count", 4000000000u}, {"mode", "ATTRIBUTES"}},
        "bufferView 0"),
    {"IndexOutOfRange", [](GlbBuilder& builder) { builder.bin[48 + 4 * 5] = 4; }, "index 4 at position 5"},
    {"NanPosition", [](GlbBuilder& builder) { SetFloat(builder, 12, std::numeric_limits<float>::quiet_NaN()); },
     "POSITION (accessor 0), vertex 1 is not finite"},
    {"InfinitePosition", [](GlbBuilder& builder) { SetFloat(builder, 44, -std::numeric_limits<float>::infinity()); },
     "mesh 0, primitive 0: POSITION (accessor 0), vertex 3"},
    {"UnequalCounts",
     [](GlbBuilder& builder) {
       At(builder, "/meshes/0/primitives/0/attributes/NORMAL") = builder.Vectors({0, 0, 1}, "VEC3");
     },
     "NORMAL (accessor 2) has 1 elements"},
    {"CycleOfThree",
     [](GlbBuilder& builder) {
       for (int i = 0; i < 3; ++i) builder.Node({{"children", {1 + (i + 1) % 3}}});
     },
     "part of a cycle"},
    {"TwoParents",
     [](GlbBuilder& builder) {
       builder.Node({{"children", {0}}});
       builder.Node({{"children", {0}}});
     },
     "node 0 is a child of both node 1 and node 2"},
    {"RootThatIsAChild",
     [](GlbBuilder& builder) {
       builder.Node({{"children", {0}}});
     },
     "which is a child of node 1"},
    {"JointWithoutSkinEntry",
     [](GlbBuilder& builder) {
       builder.doc["skins"] = {{{"joints", {0}}}};
       At(builder, "/nodes/0/skin") = 0;
       At(builder, "/meshes/0/primitives/0/attributes/JOINTS_0") =
           builder.Accessor(builder.View(ByteVector(16, 3)), testing::kU8, "VEC4", 4);
       At(builder, "/meshes/0/primitives/0/attributes/WEIGHTS_0") =
           builder.Vectors(std::vector<float>(16, 0.25f), "VEC4");
     },
     "uses joint 3, skin 0 has 1 joints"},
    {"MatricesTooFew",
     [](GlbBuilder& builder) {
       const int accessor = builder.Vectors(std::vector<float>(16, 0.0f), "MAT4");
       builder.doc["skins"] = {{{"joints", {0, 0}}, {"inverseBindMatrices", accessor}}};
     },
     "skin 0: inverseBindMatrices"},
    {"BufferLongerThanChunk",
     [](GlbBuilder& builder) {
       builder.doc["buffers"] = {{{"byteLength", builder.bin.size() + 4}}};
     },
     "buffer 0"},
};

INSTANTIATE_TEST_SUITE_P(Gltf, Malformed, ::testing::ValuesIn(kFaults),
                         [](const ::testing::TestParamInfo<Fault>& one) { return std::string(one.param.name); });

TEST(GltfMalformed, TruncatedAtEveryLength) {
  const ByteVector whole = Square().Glb();
  for (size_t length = 0; length < whole.size(); ++length) {
    EXPECT_FALSE(LoadStatus(ByteVector(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length))).ok())
        << length;
  }
}

TEST(GltfMalformed, TruncatedTextAtEveryLength) {
  const ByteVector whole = Square().Gltf();
  for (size_t length = 0; length < whole.size(); ++length) {
    EXPECT_FALSE(LoadStatus(ByteVector(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length))).ok())
        << length;
  }
}

TEST(GltfMalformed, EveryByteChanged) {
  const ByteVector whole = Square().Glb();
  int refused = 0;
  for (size_t i = 0; i < whole.size(); ++i) {
    for (const uint8_t flip : {0x01, 0x02, 0x10, 0x20, 0x80, 0xFF}) {
      ByteVector bytes = whole;
      bytes[i] ^= flip;
      // A changed coordinate is another mesh; what matters is that the answer is an error or a sound scene.
      const absl::StatusOr<Scene> scene = LoadScene(bytes);
      if (!scene.ok()) {
        ExpectOneLine(scene.status());
        ++refused;
        continue;
      }
      for (const Mesh& mesh : scene->meshes) {
        for (const Primitive& primitive : mesh.primitives) {
          for (const auto& triangle : primitive.triangles) {
            for (const uint32_t corner : triangle) ASSERT_LT(corner, primitive.positions.size()) << "byte " << i;
          }
        }
      }
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST(GltfMalformed, NamesBytesOfTheContainer) {
  const ByteVector whole = Square().Glb();
  const auto message = [&](size_t byte, uint8_t value) {
    ByteVector bytes = whole;
    bytes[byte] = value;
    return std::string(LoadStatus(bytes).message());
  };
  EXPECT_THAT(message(4, 1), HasSubstr("glTF 1.0"));
  EXPECT_THAT(message(4, 3), HasSubstr("byte 4"));
  EXPECT_THAT(message(11, 0x70), HasSubstr("byte 8"));
  EXPECT_THAT(message(15, 0x70), HasSubstr("byte 12"));
  EXPECT_THAT(message(16, 'X'), HasSubstr("first chunk is not JSON"));
  EXPECT_THAT(message(20, 'X'), HasSubstr("byte 1"));
}

TEST(GltfMalformed, DeepJsonIsRefusedBeforeItIsParsed) {
  for (const char* bracket : {"[", "{\"a\":"}) {
    std::string text = "{\"asset\":{\"version\":\"2.0\"},\"extras\":";
    for (int i = 0; i < 250'000; ++i) text += bracket;
    const absl::Status status = LoadStatus(ByteVector(text.begin(), text.end()));
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
    EXPECT_THAT(std::string(status.message()), HasSubstr("max_json_depth"));
  }
}

TEST(GltfMalformed, BracketsInStringsAreNoDepth) {
  GlbBuilder builder = Square();
  builder.doc["nodes"][0]["name"] = std::string(1000, '[') + "\\\"" + std::string(1000, '{');
  EXPECT_TRUE(LoadStatus(builder.Glb()).ok());
}

TEST(GltfMalformed, ZerosThatStandForGigabytes) {
  for (const uint64_t count : {3'000'000'000u, 4'294'967'295u}) {
    GlbBuilder builder;
    const int accessor = builder.Accessor(-1, testing::kF32, "VEC3", count);
    builder.Scene({builder.Node({{"mesh", builder.Mesh({{"attributes", {{"POSITION", accessor}}}})}})});
    const absl::Status status = LoadStatus(builder.Glb());
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
    EXPECT_THAT(std::string(status.message()), HasSubstr("accessor 0"));
  }
}

TEST(GltfMalformed, ManyMeshesOfOneAccessorMeetTheBudget) {
  GlbBuilder builder = Square();
  for (int i = 0; i < 1000; ++i) builder.Mesh(builder.doc["meshes"][0]["primitives"][0]);
  JobContext job;
  MemoryBudget ample(64 << 20), small(1 << 20);
  job.set_memory(&ample);
  EXPECT_TRUE(LoadSceneFor(job, builder.Glb()).ok());
  job.set_memory(&small);
  const absl::Status status = LoadSceneFor(job, builder.Glb()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  ASSERT_TRUE(LimitErrorOf(status).has_value()) << status;
  EXPECT_GT(LimitErrorOf(status)->need_bytes, small.limit_bytes());
  EXPECT_EQ(LimitErrorOf(status)->limit_bytes, small.limit_bytes());
  EXPECT_EQ(small.used_bytes(), 0u);
}

TEST(GltfMalformed, LimitsAreNamed) {
  const auto message = [](const LoadLimits& limits) {
    GlbBuilder builder = Square();
    for (int i = 0; i < 9; ++i) builder.Node({{"children", json::array({i + 2})}});
    builder.Node(json::object());
    const absl::Status status = LoadScene(builder.Glb(), MeshFormat::kAuto, limits).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
    return std::string(status.message());
  };
  LoadLimits limits;
  limits.max_nodes = 10;
  EXPECT_THAT(message(limits), HasSubstr("max_nodes"));
  limits = LoadLimits{};
  limits.max_node_depth = 9;
  EXPECT_THAT(message(limits), HasSubstr("max_node_depth"));
  limits = LoadLimits{};
  limits.max_json_bytes = 100;
  EXPECT_THAT(message(limits), HasSubstr("max_json_bytes"));
  limits = LoadLimits{};
  limits.max_file_bytes = 100;
  EXPECT_THAT(message(limits), HasSubstr("max_file_bytes"));
  limits = LoadLimits{};
  limits.max_triangles = 1;
  EXPECT_THAT(message(limits), HasSubstr("max_triangles"));
}

TEST(GltfMalformed, DataUris) {
  const auto load = [](const std::string& uri) {
    GlbBuilder builder = Square();
    builder.doc["buffers"] = {{{"byteLength", builder.bin.size()}, {"uri", uri}}};
    const std::string text = builder.doc.dump();
    return LoadStatus(ByteVector(text.begin(), text.end()));
  };
  const std::string good = testing::Base64(Square().bin);
  const std::string head = "data:application/octet-stream;base64,";
  EXPECT_TRUE(load(head + good).ok());
  std::string escaped;
  for (const char c : good) escaped += c == '+' ? "%2B" : c == '/' ? "%2f" : c == '=' ? "%3D" : std::string(1, c);
  EXPECT_TRUE(load(head + escaped).ok());
  std::string percent = "data:,";
  for (const uint8_t byte : Square().bin) {
    constexpr char kHex[] = "0123456789ABCDEF";
    percent += {'%', kHex[byte >> 4], kHex[byte & 15]};
  }
  EXPECT_TRUE(load(percent).ok());
  for (const std::string& bad :
       {head + good.substr(0, good.size() - 8), head + "****" + good.substr(4), head + good + "A", std::string("data:"),
        std::string("data:,%4"), std::string("data:,%zz"), head}) {
    const absl::Status status = load(bad);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << bad;
    EXPECT_THAT(std::string(status.message()), HasSubstr("buffer 0")) << bad;
  }
}

TEST(GltfMalformed, NamesOfStrangersStayOneLine) {
  GlbBuilder builder = Square();
  builder.doc["extensionsRequired"] = {"EVIL\n\x1b[31m" + std::string(500, 'x')};
  EXPECT_THAT(std::string(LoadStatus(builder.Glb()).message()), AllOf(HasSubstr("EVIL\\n"), Not(HasSubstr("\n"))));
}

}  // namespace
}  // namespace voxelpipe
