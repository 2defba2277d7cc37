#include "access/tokens.h"

#include <cstdio>
#include <fstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// SHA-256 of "correct horse battery staple".
constexpr char kStaple[] = "c4bbcb1fbec99d65bf59d85c8cb62ee2db963f0fe106f483d9afa73bd4e39a8a";

TEST(TokensTest, ATokenAndTheDigestOfATokenBothFindTheirClient) {
  const auto table = TokenTable::Parse(std::string(R"({"clients": [
      {"name": "farm", "role": "user", "token": "0123456789abcdef", "calls_per_second": 2.5, "burst_calls": 7,
       "calls_at_once": 3, "bytes_per_second": 1000, "burst_bytes": 2000},
      {"name": "boss", "role": "admin", "token_sha256": [")") +
                                       kStaple + R"("], "token": ["second-token-of-boss"]}]})");
  ASSERT_TRUE(table.ok()) << table.status();
  const TokenClient* farm = table->Find("0123456789abcdef");
  ASSERT_NE(farm, nullptr);
  EXPECT_EQ(farm->name, "farm");
  EXPECT_EQ(farm->role, Role::kUser);
  EXPECT_EQ(farm->limits, (QuotaLimits{2.5, 7, 3, 1000, 2000}));
  for (const char* token : {"correct horse battery staple", "second-token-of-boss"}) {
    const TokenClient* boss = table->Find(token);
    ASSERT_NE(boss, nullptr) << token;
    EXPECT_EQ(boss->name, "boss");
    EXPECT_EQ(boss->role, Role::kAdmin);
  }
  for (const char* token : {"", "0123456789abcde", "0123456789abcdeF", "0123456789abcdef ", kStaple}) {
    EXPECT_EQ(table->Find(token), nullptr) << token;
  }
}

TEST(TokensTest, WhatIsWrongIsNamedAndNoTokenIsTold) {
  struct Case {
    const char *text, *error;
  };
  const Case cases[] = {
      {"{", "is not JSON"},
      {"[]", "one list, clients"},
      {R"({"clients": [], "more": 1})", "one list, clients"},
      {R"({"clients": [1]})", "clients[0]: needs to be an object"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret"}]})", "clients[0].token: needs 16 to 512"},
      {R"({"clients": [{"name": "a", "role": "user", "token_sha256": "secret"}]})",
       "clients[0].token_sha256: needs 64"},
      {R"({"clients": [{"name": "a", "role": "god", "token": "secret-secret-secret"}]})", "clients[0].role"},
      {R"({"clients": [{"name": "a", "token": "secret-secret-secret"}]})", "clients[0].role: is missing"},
      {R"({"clients": [{"name": "a", "role": "user"}]})", "clients[0].token_sha256: is missing"},
      {R"({"clients": [{"name": "a b", "role": "user", "token": "secret-secret-secret"}]})", "clients[0].name"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret-secret-secret", "quota": 1}]})",
       "clients[0].quota: is not known"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret-secret-secret", "burst_calls": 5}]})",
       "clients[0].burst_calls: has no effect"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret-secret-secret", "burst_bytes": 5}]})",
       "clients[0].burst_bytes: has no effect"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret-secret-secret", "calls_at_once": -1}]})",
       "clients[0].calls_at_once"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret-secret-secret", "calls_at_once": 1e10}]})",
       "clients[0].calls_at_once"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret-secret-secret"},
                       {"name": "a", "role": "user", "token": "secret-secret-secre2"}]})",
       "clients[1].name: is given twice"},
      {R"({"clients": [{"name": "a", "role": "user", "token": "secret-secret-secret"},
                       {"name": "b", "role": "user", "token": "secret-secret-secret"}]})",
       "clients[1]: has a token that is given twice"},
  };
  for (const Case& c : cases) {
    const auto table = TokenTable::Parse(c.text);
    ASSERT_EQ(table.status().code(), absl::StatusCode::kInvalidArgument) << c.text;
    EXPECT_THAT(std::string(table.status().message()), HasSubstr(c.error));
    EXPECT_THAT(std::string(table.status().message()), Not(HasSubstr("secret")));
  }
}

TEST(TokensTest, AFileThatIsNotThereIsNotFound) {
  EXPECT_EQ(TokenTable::Read("/nowhere/at/all").status().code(), absl::StatusCode::kNotFound);
}

TEST(TokensTest, AMonitorLooksAndAUserWorks) {
  for (const Rpc rpc : {Rpc::kGetServerInfo, Rpc::kListShaders, Rpc::kHealthCheck, Rpc::kHealthWatch}) {
    EXPECT_TRUE(MayCall(Role::kMonitor, rpc)) << RpcName(rpc);
  }
  // DeleteMesh itself refuses a user.
  for (const Rpc rpc :
       {Rpc::kVoxelize, Rpc::kVoxelizeUpload, Rpc::kVoxelizeBatch, Rpc::kExportFile, Rpc::kEstimateVoxelization,
        Rpc::kCreateMesh, Rpc::kUploadMesh, Rpc::kGetMesh, Rpc::kListMeshes, Rpc::kReleaseMesh, Rpc::kDeleteMesh}) {
    EXPECT_FALSE(MayCall(Role::kMonitor, rpc)) << RpcName(rpc);
    EXPECT_TRUE(MayCall(Role::kUser, rpc)) << RpcName(rpc);
    EXPECT_TRUE(MayCall(Role::kAdmin, rpc)) << RpcName(rpc);
  }
}

}  // namespace
}  // namespace voxelpipe
