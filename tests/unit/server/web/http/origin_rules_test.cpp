#include "web/http/origin_rules.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(OriginRulesTest, ParsesOrigins) {
  EXPECT_THAT(*ParseOrigins(""), IsEmpty());
  EXPECT_THAT(*ParseOrigins("https://Voxels.example.org, http://[::1]:8000,"),
              ElementsAre("https://voxels.example.org", "http://[::1]:8000"));
  for (const char* const wrong : {"voxels.example.org", "*", "https://", "https://a/b", "https://a:b",
                                  "https://a:70000", "https://a b", "ftp://a", "null", "https://a@b", "https://[::1"}) {
    EXPECT_EQ(ParseOrigins(wrong).status().code(), absl::StatusCode::kInvalidArgument) << wrong;
  }
}

class RulesTest : public ::testing::Test {
 protected:
  bool Allows(const RequestSource& source) const { return rules_.Check(source).ok(); }

  const OriginRules rules_{"voxels.lan:8080", {"https://voxels.example.org"}};
};

TEST_F(RulesTest, HostsThatNobodyCanRebind) {
  for (const char* const host : {"127.0.0.1:8080", "127.0.0.1", "10.1.2.3:9", "[::1]:8080", "[::1]", "localhost:8080",
                                 "LOCALHOST", "voxels.lan:8080", "voxels.example.org"}) {
    EXPECT_TRUE(Allows({host, {}, {}})) << host;
  }
  for (const char* const host : {"evil.example", "evil.example:8080", "127.0.0.1.evil.example:8080", "", ":8080",
                                 "voxels.example.org:8080", "localhost.evil.example", "127.0.0.1:8080, evil.example",
                                 "[::1", "[::1]x:80", "127.0.0.1:port", "127.0.0.1:", "localhost:123456"}) {
    EXPECT_FALSE(Allows({host, {}, {}})) << host;
  }
  EXPECT_FALSE(Allows({})) << "a request without Host";
}

TEST_F(RulesTest, OriginsOfPages) {
  EXPECT_TRUE(Allows({"127.0.0.1:8080", "http://127.0.0.1:8080", "same-origin"}));
  EXPECT_TRUE(Allows({"127.0.0.1:8080", "https://voxels.example.org", "cross-site"}));
  for (const char* const origin : {"http://evil.example", "https://127.0.0.1:8080", "http://127.0.0.1:3000",
                                   "http://localhost:8080", "null", "", "https://voxels.example.org.evil.example"}) {
    EXPECT_FALSE(Allows({"127.0.0.1:8080", origin, {}})) << origin;
  }
}

TEST_F(RulesTest, RequestsWithoutAnOrigin) {
  EXPECT_TRUE(Allows({"127.0.0.1:8080", {}, {}})) << "no browser";
  EXPECT_TRUE(Allows({"127.0.0.1:8080", {}, "none"})) << "typed by the user";
  EXPECT_TRUE(Allows({"127.0.0.1:8080", {}, "same-origin"}));
  EXPECT_FALSE(Allows({"127.0.0.1:8080", {}, "cross-site"}));
  EXPECT_FALSE(Allows({"127.0.0.1:8080", {}, "same-site"}));
}

TEST_F(RulesTest, OnlyListedOriginsMayRead) {
  EXPECT_TRUE(rules_.IsForeignAllowed({"127.0.0.1:8080", "https://voxels.example.org", {}}));
  EXPECT_FALSE(rules_.IsForeignAllowed({"127.0.0.1:8080", "http://127.0.0.1:8080", {}}));
  EXPECT_FALSE(rules_.IsForeignAllowed({"127.0.0.1:8080", {}, {}}));
}

}  // namespace
}  // namespace voxelpipe
