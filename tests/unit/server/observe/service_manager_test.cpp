#include "observe/service_manager.h"

#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/resources/notify_socket.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::HasSubstr;
using testing::NotifySocket;
using testing::TemporaryDirectory;

constexpr seconds kPatience{30};

class ServiceManagerTest : public ::testing::Test {
 protected:
  ~ServiceManagerTest() override { Set("", "", ""); }
  // An empty value: no variable.
  static void Set(const std::string& socket, const std::string& microseconds, const std::string& pid) {
    const std::vector<std::pair<const char*, std::string>> variables = {
        {"NOTIFY_SOCKET", socket}, {"WATCHDOG_USEC", microseconds}, {"WATCHDOG_PID", pid}};
    for (const auto& [name, value] : variables) {
      value.empty() ? unsetenv(name) : setenv(name, value.c_str(), /*overwrite=*/1);
    }
  }

  const TemporaryDirectory directory_;
};

TEST_F(ServiceManagerTest, WithoutOneNothingIsSentAndNothingFails) {
  Set("", "1000000", "");
  const ServiceManager none = ServiceManager::OfEnvironment();
  EXPECT_EQ(none.alive_interval().count(), 0);
  EXPECT_TRUE(none.Ready("serving").ok());
  EXPECT_TRUE(none.Stopping(seconds(1)).ok());
  EXPECT_TRUE(none.Alive().ok());
}

TEST_F(ServiceManagerTest, MessagesAreThoseOfTheProtocol) {
  const std::string abstract = absl::StrCat("@voxelpipe-test-", getpid());
  for (const std::string& name : {directory_ / "notify", abstract}) {
    NotifySocket socket(name);
    Set(name, "", "");
    const ServiceManager manager = ServiceManager::OfEnvironment();
    ASSERT_TRUE(manager.Ready("serving on 127.0.0.1:1").ok()) << name;
    ASSERT_TRUE(manager.Alive().ok());
    ASSERT_TRUE(manager.Stopping(milliseconds(45'500)).ok());
    EXPECT_EQ(socket.Receive(kPatience), "READY=1\nSTATUS=serving on 127.0.0.1:1");
    EXPECT_EQ(socket.Receive(kPatience), "WATCHDOG=1");
    EXPECT_EQ(socket.Receive(kPatience), "STOPPING=1\nSTATUS=draining\nEXTEND_TIMEOUT_USEC=45500000");
    EXPECT_EQ(socket.Receive(milliseconds(0)), std::nullopt);
  }
}

TEST_F(ServiceManagerTest, SignsOfLifeAreDueAtHalfOfTheTimeAndOnlyFromTheProcessThatIsWatched) {
  const auto interval = [](const std::string& microseconds, const std::string& pid) {
    Set("/nowhere", microseconds, pid);
    return ServiceManager::OfEnvironment().alive_interval().count();
  };
  EXPECT_EQ(interval("30000000", ""), 15'000);
  EXPECT_EQ(interval("30000000", std::to_string(getpid())), 15'000);
  EXPECT_EQ(interval("30000000", std::to_string(getpid() + 1)), 0);
  EXPECT_EQ(interval("30000000", "nobody"), 0);
  EXPECT_EQ(interval("1", ""), 1) << "never a loop without a pause";
  for (const char* invalid : {"", "0", "-5", "soon"}) EXPECT_EQ(interval(invalid, ""), 0) << invalid;
}

TEST_F(ServiceManagerTest, AnAddressThatIsNoneIsNamed) {
  const auto error = [](const std::string& socket) {
    return std::string(ServiceManager(socket, seconds(0)).Ready("").message());
  };
  EXPECT_THAT(error("notify"), HasSubstr("'notify' is no address of a unix socket"));
  EXPECT_THAT(error("/" + std::string(107, 'x')), HasSubstr("is no address of a unix socket"));
  EXPECT_THAT(error(directory_ / "missing"), HasSubstr("No such file"));
  const std::string longest = directory_ / "";
  NotifySocket socket(longest + std::string(107 - longest.size(), 'x'));
  EXPECT_EQ(error(socket.name()), "");
}

}  // namespace
}  // namespace voxelpipe
