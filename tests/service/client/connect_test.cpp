// How often a client tries to connect.
#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <grpcpp/server_posix.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe::testing {
namespace {

// A port of the loopback whose first connections are closed as soon as they stand; one more is served, if there is one.
class LateServer {
 public:
  explicit LateServer(int closed_connections) {
    grpc::ServerBuilder builder;
    builder.RegisterCallbackGenericService(&nothing_);
    server_ = builder.BuildAndStart();
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* const any = reinterpret_cast<sockaddr*>(&address);
    listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    EXPECT_EQ(bind(listener_, any, size), 0);
    EXPECT_EQ(listen(listener_, 8), 0);
    EXPECT_EQ(getsockname(listener_, any, &size), 0);
    target_ = absl::StrCat("127.0.0.1:", ntohs(address.sin_port));
    acceptor_ = std::thread([this, closed_connections] {
      for (;;) {
        const int connection = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
        if (connection < 0) return;
        if (++attempts_ > closed_connections) {
          grpc::AddInsecureChannelFromFd(server_.get(), connection);  // which owns it from here on
        } else {
          close(connection);
        }
      }
    });
  }
  ~LateServer() {
    shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    close(listener_);
    server_->Shutdown();
  }
  LateServer(const LateServer&) = delete;
  LateServer& operator=(const LateServer&) = delete;

  const std::string& target() const { return target_; }
  int attempts() const { return attempts_; }

 private:
  grpc::CallbackGenericService nothing_;
  std::unique_ptr<grpc::Server> server_;
  int listener_ = -1;
  std::string target_;
  std::atomic<int> attempts_ = 0;
  std::thread acceptor_;
};

TEST(ConnectTest, AnAttemptThatFailsIsMadeAgainAtOnce) {
  const LateServer server(1);
  const absl::StatusOr<std::unique_ptr<Client>> client = Client::Connect(server.target());
  EXPECT_TRUE(client.ok()) << client.status();
  EXPECT_GE(server.attempts(), 2);
}

TEST(ConnectTest, FailuresOneAfterAnotherAreBelieved) {
  const LateServer server(1000);
  const absl::StatusOr<std::unique_ptr<Client>> client = Client::Connect(server.target());
  EXPECT_TRUE(absl::IsUnavailable(client.status())) << client.status();
  EXPECT_THAT(std::string(client.status().message()), ::testing::HasSubstr(server.target()));
  EXPECT_LE(server.attempts(), 3);
}

}  // namespace
}  // namespace voxelpipe::testing
