#include "web/page_facts.h"

#include <google/protobuf/duration.pb.h>

#include "encode/format_registry.h"
#include "gtest/gtest.h"
#include "support/json/json.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "web/page_files.h"

namespace voxelpipe {
namespace {

using nlohmann::json;

TEST(PageFactsTest, DescribeTheMessagesAsTheyAre) {
  const json facts = testing::ParseJson(PageFacts());
  const json& stored = facts["messages"]["StoredMesh"];
  EXPECT_EQ(stored["name"]["number"], v1::StoredMesh::kNameFieldNumber);
  EXPECT_EQ(stored["name"]["type"], "string");
  EXPECT_EQ(facts["messages"]["VoxelizeSpec"]["targets"], (json{{"number", v1::VoxelizeSpec::kTargetsFieldNumber},
                                                                {"type", "message"},
                                                                {"repeated", true},
                                                                {"of", "RenderTarget"}}));
  EXPECT_EQ(facts["messages"]["Duration"]["nanos"]["number"], google::protobuf::Duration::kNanosFieldNumber);
  EXPECT_EQ(facts["enums"]["Fill"]["FILL_NONZERO"], int(v1::FILL_NONZERO));
}

TEST(PageFactsTest, DescribeTheMethodsThatBrowsersCanCall) {
  const json facts = testing::ParseJson(PageFacts());
  const json& methods = facts["methods"];
  EXPECT_EQ(methods["CreateMesh"], (json{{"request", "CreateMeshRequest"}, {"response", "Mesh"}}));
  EXPECT_EQ(methods["Voxelize"], (json{{"request", "VoxelizeRequest"}, {"response", "VoxelizeResponse"}}));
  EXPECT_FALSE(methods.contains("VoxelizeUpload")) << "it takes a stream";
  for (const auto& [name, method] : methods.items()) {
    EXPECT_TRUE(facts["messages"].contains(method["request"])) << name;
    EXPECT_TRUE(facts["messages"].contains(method["response"])) << name;
  }
}

TEST(PageFactsTest, NameNothingThatTheyDoNotDescribe) {
  const json facts = testing::ParseJson(PageFacts());
  size_t named = 0;
  for (const auto& [name, fields] : facts["messages"].items()) {
    for (const auto& [key, field] : fields.items()) {
      if (!field.contains("of") || field["of"] == "Status") continue;  // of google.rpc, in streams of batches only
      const json& known = facts[field["type"] == "enum" ? "enums" : "messages"];
      EXPECT_TRUE(known.contains(field["of"])) << name << "." << key;
      ++named;
    }
  }
  EXPECT_GT(named, 50u);
  EXPECT_EQ(facts["formats"].size(), OutputFormats().size());
}

TEST(PageFilesTest, AreWhole) {
  for (const char* const path : {"/", "/page.css", "/page.js", "/client.js", "/example.js", "/mesh.js", "/messages.js",
                                 "/options.js", "/rules.js", "/viewer.css", "/viewer.js", "/facts.json"}) {
    const PageFile* const file = FindPageFile(path);
    ASSERT_NE(file, nullptr) << path;
    EXPECT_GT(file->text.size(), 100u) << path;
    EXPECT_EQ(file->text.find('\0'), std::string_view::npos) << path;
  }
  EXPECT_EQ(FindPageFile("/page.html"), nullptr);
  EXPECT_EQ(FindPageFile(""), nullptr);
}

}  // namespace
}  // namespace voxelpipe
