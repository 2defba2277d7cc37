#include "access/access_control.h"

#include <fstream>
#include <string>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/resources/temporary_directory.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

class AccessControlTest : public ::testing::Test {
 protected:
  void Write(const std::string& clients) { std::ofstream(path_) << "{\"clients\": [" << clients << "]}"; }
  std::unique_ptr<AccessControl> Make(bool open_health = true) {
    auto control = AccessControl::Create(path_, open_health, metrics_);
    EXPECT_TRUE(control.ok()) << control.status();
    return control.ok() ? *std::move(control) : nullptr;
  }
  absl::StatusCode CodeFor(AccessControl& control, std::optional<std::string_view> authorization,
                           Rpc rpc = Rpc::kVoxelize) {
    return control.Admit(authorization, rpc).status().code();
  }

  const testing::TemporaryDirectory directory_;
  const std::string path_ = directory_ / "tokens.json";
  Metrics metrics_;
};

constexpr char kUser[] = R"({"name": "farm", "role": "user", "token": "token-of-the-farm", "calls_at_once": 1})";
constexpr char kMonitor[] = R"({"name": "eye", "role": "monitor", "token": "token-of-the-eye"})";

TEST_F(AccessControlTest, WithoutATokenFileEverybodyMayDoEverything) {
  const auto control = AccessControl::Create("", false, metrics_);
  ASSERT_TRUE(control.ok());
  const auto admitted = (*control)->Admit(std::nullopt, Rpc::kDeleteMesh);
  ASSERT_TRUE(admitted.ok());
  EXPECT_EQ(admitted->role(), Role::kAdmin);
  EXPECT_EQ(admitted->name(), "");
}

TEST_F(AccessControlTest, ATokenOpensWhatItsRoleMayDo) {
  Write(std::string(kUser) + "," + kMonitor);
  const auto control = Make();
  const auto admitted = control->Admit("Bearer token-of-the-farm", Rpc::kVoxelize);
  ASSERT_TRUE(admitted.ok()) << admitted.status();
  EXPECT_EQ(admitted->name(), "farm");
  EXPECT_EQ(admitted->role(), Role::kUser);
  EXPECT_EQ(CodeFor(*control, "bearer token-of-the-eye", Rpc::kGetServerInfo), absl::StatusCode::kOk);
  EXPECT_EQ(CodeFor(*control, "bearer token-of-the-eye"), absl::StatusCode::kPermissionDenied);
}

TEST_F(AccessControlTest, ARefusalIsCountedUnderItsReason) {
  Write(std::string(kUser) + "," + kMonitor);
  const auto control = Make();
  EXPECT_EQ(CodeFor(*control, std::nullopt), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(CodeFor(*control, "Bearer wrong"), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(CodeFor(*control, "token-of-the-farm"), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(CodeFor(*control, "Basic dXNlcjpwYXNz"), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-eye"), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(metrics_.Refused(Refusal::kNoToken).Value(), 1);
  EXPECT_EQ(metrics_.Refused(Refusal::kBadToken).Value(), 3);
  EXPECT_EQ(metrics_.Refused(Refusal::kRole).Value(), 1);
}

TEST_F(AccessControlTest, WhoIsRefusedIsNamedWhereItsTokenIsKnown) {
  Write(std::string(kUser) + "," + kMonitor);
  const auto control = Make();
  const auto who = [&](std::optional<std::string_view> authorization) {
    std::string name;
    control->Admit(authorization, Rpc::kVoxelize, "", QuotaClock::now(), &name).status().IgnoreError();
    return name;
  };
  EXPECT_EQ(who("Bearer token-of-the-eye"), "eye") << "its role may not";
  const auto first = control->Admit("Bearer token-of-the-farm", Rpc::kVoxelize);
  ASSERT_TRUE(first.ok());
  EXPECT_EQ(who("Bearer token-of-the-farm"), "farm") << "beyond its quota";
  EXPECT_EQ(who("Bearer token-of-a-stranger"), "");
  EXPECT_EQ(who(std::nullopt), "");
}

TEST_F(AccessControlTest, HealthIsOpenUnlessToldOtherwise) {
  Write(kUser);
  EXPECT_EQ(CodeFor(*Make(true), std::nullopt, Rpc::kHealthCheck), absl::StatusCode::kOk);
  EXPECT_EQ(CodeFor(*Make(false), std::nullopt, Rpc::kHealthCheck), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(CodeFor(*Make(false), "Bearer token-of-the-farm", Rpc::kHealthCheck), absl::StatusCode::kOk);
}

TEST_F(AccessControlTest, AQuotaRefusesWithADelayAndIsGivenBack) {
  Write(kUser);
  const auto control = Make();
  {
    const auto first = control->Admit("Bearer token-of-the-farm", Rpc::kVoxelize);
    ASSERT_TRUE(first.ok());
    const auto second = control->Admit("Bearer token-of-the-farm", Rpc::kVoxelize);
    EXPECT_EQ(second.status().code(), absl::StatusCode::kResourceExhausted);
    EXPECT_TRUE(RetryDelay(second.status()));
    EXPECT_EQ(metrics_.Refused(Refusal::kQuotaCalls).Value(), 1);
  }
  EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-farm"), absl::StatusCode::kOk);
}

TEST_F(AccessControlTest, ACheckDecidesAsAnAdmissionAndTakesNothing) {
  Write(std::string(kUser) + "," + kMonitor + "," +
        R"({"name": "few", "role": "user", "token": "token-of-the-few", "calls_per_second": 0.001})");
  const auto control = Make();
  const auto check = [&](std::optional<std::string_view> authorization, Rpc rpc = Rpc::kVoxelize) {
    return control->Check(authorization, rpc).code();
  };
  EXPECT_EQ(check(std::nullopt), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(check("Bearer wrong"), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(check("Bearer token-of-the-eye"), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(check("Bearer token-of-the-eye", Rpc::kListShaders), absl::StatusCode::kOk);
  for (const char* const token : {"Bearer token-of-the-farm", "Bearer token-of-the-few"}) {
    EXPECT_EQ(check(token), absl::StatusCode::kOk);
    EXPECT_EQ(check(token), absl::StatusCode::kOk) << "the first took nothing";
    const auto admitted = control->Admit(token, Rpc::kVoxelize);
    EXPECT_TRUE(admitted.ok()) << admitted.status();
    EXPECT_EQ(check(token), absl::StatusCode::kResourceExhausted);
  }
  EXPECT_EQ(metrics_.Refused(Refusal::kNoToken).Value(), 1);
  EXPECT_EQ(metrics_.Refused(Refusal::kBadToken).Value(), 1);
  EXPECT_EQ(metrics_.Refused(Refusal::kRole).Value(), 1);
  EXPECT_EQ(metrics_.Refused(Refusal::kQuotaCalls).Value(), 1);
  EXPECT_EQ(metrics_.Refused(Refusal::kQuotaRate).Value(), 1);
}

TEST_F(AccessControlTest, AMovedAdmissionGivesItsPlaceBackOnce) {
  Write(kUser);
  const auto control = Make();
  {
    auto first = control->Admit("Bearer token-of-the-farm", Rpc::kVoxelize);
    const Admitted moved = *std::move(first);
    EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-farm"), absl::StatusCode::kResourceExhausted);
  }
  EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-farm"), absl::StatusCode::kOk);
}

TEST_F(AccessControlTest, AChangedFileIsReadAndABadOneIsNot) {
  Write(kUser);
  const auto control = Make();
  const auto still_running = control->Admit("Bearer token-of-the-farm", Rpc::kVoxelize);
  ASSERT_TRUE(still_running.ok());
  Write(std::string(kUser) + "," + kMonitor);
  control->ReloadIfChanged();
  EXPECT_EQ(metrics_.reloads.Value(), 1);
  EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-eye", Rpc::kGetServerInfo), absl::StatusCode::kOk);
  EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-farm"), absl::StatusCode::kResourceExhausted)
      << "what a client uses survives the reload";
  control->ReloadIfChanged();
  EXPECT_EQ(metrics_.reloads.Value(), 1) << "nothing has changed";
  std::ofstream(path_) << "{ half a fi";
  control->ReloadIfChanged();
  EXPECT_EQ(metrics_.reload_failures.Value(), 1);
  EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-eye", Rpc::kGetServerInfo), absl::StatusCode::kOk);
  control->ReloadIfChanged();
  EXPECT_EQ(metrics_.reload_failures.Value(), 1) << "the same bad file is told once";
  Write(kMonitor);
  control->ReloadIfChanged();
  EXPECT_EQ(CodeFor(*control, "Bearer token-of-the-farm"), absl::StatusCode::kUnauthenticated);
}

TEST_F(AccessControlTest, AFileThatCannotBeReadStopsTheStart) {
  const auto control = AccessControl::Create("/nowhere/at/all", true, metrics_);
  EXPECT_THAT(std::string(control.status().message()), HasSubstr("/nowhere/at/all"));
}

}  // namespace
}  // namespace voxelpipe
