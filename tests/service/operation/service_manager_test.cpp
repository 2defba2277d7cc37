// A server under a service manager: what it reports, and when.
#include <signal.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/resources/notify_socket.h"
#include "support/resources/temporary_directory.h"

namespace voxelpipe::testing {
namespace {

using std::chrono::milliseconds;
using ::testing::StartsWith;

constexpr milliseconds kWatchdog{400 * kSlowdown};

class ServiceManagerTest : public ::testing::Test {
 protected:
  ServiceManagerTest() {
    setenv("NOTIFY_SOCKET", socket_.name().c_str(), /*overwrite=*/1);
    setenv("WATCHDOG_USEC", std::to_string(std::chrono::microseconds(kWatchdog).count()).c_str(), /*overwrite=*/1);
  }
  ~ServiceManagerTest() override {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
  }
  // The next message that is no sign of life.
  std::optional<std::string> Next() {
    std::optional<std::string> message;
    do {
      message = socket_.Receive(kPatience);
    } while (message == "WATCHDOG=1");
    return message;
  }

  const TemporaryDirectory directory_;
  NotifySocket socket_{directory_ / "notify"};
};

TEST_F(ServiceManagerTest, ReadyOnceItServesAliveWhileItWorksStoppingAtSigterm) {
  const std::unique_ptr<ServerProcess> server =
      StartServer({"--log-level", "error", "--lame-duck-ms", "700", "--drain-grace-ms", "20000"});
  ASSERT_NE(server, nullptr);
  EXPECT_EQ(socket_.Receive(kPatience), "READY=1\nSTATUS=serving on " + server->address());
  const std::unique_ptr<Client> client = ConnectTo(*server);
  ASSERT_NE(client, nullptr);
  EXPECT_TRUE(client->CheckHealth().ok());
  for (int i = 0; i < 3; ++i) EXPECT_EQ(socket_.Receive(kPatience), "WATCHDOG=1");
  server->Signal(SIGTERM);
  EXPECT_EQ(Next(), "STOPPING=1\nSTATUS=draining\nEXTEND_TIMEOUT_USEC=30700000");
  EXPECT_EQ(socket_.Receive(kPatience), "WATCHDOG=1") << "none while it drains";
  const absl::StatusOr<CommandResult> end = server->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

TEST_F(ServiceManagerTest, AStoppedProcessGivesNoSignOfLife) {
  const std::unique_ptr<ServerProcess> server = StartServer({"--log-level", "error"});
  ASSERT_NE(server, nullptr);
  EXPECT_THAT(socket_.Receive(kPatience).value_or(""), StartsWith("READY=1\n"));
  EXPECT_EQ(socket_.Receive(kPatience), "WATCHDOG=1");
  server->Signal(SIGSTOP);
  while (socket_.Receive(kWatchdog)) {}  // what it had sent
  EXPECT_EQ(socket_.Receive(3 * kWatchdog), std::nullopt);
  server->Signal(SIGCONT);
  EXPECT_EQ(socket_.Receive(kPatience), "WATCHDOG=1");
}

// As the unit has it: the manager hears of it before the first call is refused, and no call that was under way is lost.
TEST_F(ServiceManagerTest, SigtermUnderLoadLosesNoCall) {
  const std::unique_ptr<ServerProcess> server =
      StartServer({"--log-level", "error", "--lame-duck-ms", "1500", "--workers", "2"});
  ASSERT_NE(server, nullptr);
  const std::vector<uint8_t> mesh = TorusGlb(8);
  constexpr int kClients = 6;
  std::atomic<bool> told{false};
  std::atomic<int> served{0}, late{0};
  std::mutex mutex;
  std::vector<std::string> lost;
  std::vector<std::thread> clients;
  for (int i = 0; i < kClients; ++i) {
    clients.emplace_back([&] {
      const std::unique_ptr<Client> client = ConnectTo(*server);
      while (client != nullptr && !told) {
        JobContext job;
        job.set_deadline(JobContext::Clock::now() + kPatience);
        const absl::Status status = client->Voxelize(mesh, MeshFormat::kGlb, SmallRequest(), job).status();
        ++(told ? late : served);
        const std::lock_guard lock(mutex);
        if (!status.ok()) lost.push_back(status.ToString());
      }
    });
  }
  EXPECT_THAT(Next().value_or(""), StartsWith("READY=1\n"));
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (served < 50 && std::chrono::steady_clock::now() < give_up) std::this_thread::sleep_for(milliseconds(1));
  server->Signal(SIGTERM);
  EXPECT_THAT(Next().value_or(""), StartsWith("STOPPING=1\n"));
  const int before = served;
  while (served < before + 20 && std::chrono::steady_clock::now() < give_up)
    std::this_thread::sleep_for(milliseconds(1));
  told = true;
  for (std::thread& client : clients) client.join();
  EXPECT_THAT(lost, ::testing::IsEmpty());
  EXPECT_GE(served, before + 20) << "calls are taken while health says NOT_SERVING";
  const absl::StatusOr<CommandResult> end = server->Wait();
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(end->exit_code, 0);
}

}  // namespace
}  // namespace voxelpipe::testing
