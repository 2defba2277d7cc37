#include "observe/http_endpoint.h"

#include <array>
#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "observe/http_status.h"
#include "observe/metrics.h"

namespace voxelpipe {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// A connection to the endpoint.
class Connection {
 public:
  explicit Connection(const std::string& address) : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(uint16_t(std::stoi(address.substr(address.rfind(':') + 1))));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    open_ = connect(fd_, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0;
  }
  ~Connection() { close(fd_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool open() const { return open_; }
  bool Say(const std::string& text) {
    return send(fd_, text.data(), text.size(), MSG_NOSIGNAL) == ssize_t(text.size());
  }
  // All that it answers to these bytes.
  std::string Talk(const std::string& request) {
    std::string answer;
    if (open_ && Say(request)) {
      std::array<char, 4096> buffer{};
      for (ssize_t n; (n = recv(fd_, buffer.data(), buffer.size(), 0)) > 0;) answer.append(buffer.data(), size_t(n));
    }
    return answer;
  }

 private:
  const int fd_;
  bool open_ = false;
};

std::string Talk(const std::string& address, const std::string& request) {
  return Connection(address).Talk(request);
}

std::string Get(const std::string& address, const std::string& path) {
  return Talk(address, "GET " + path + " HTTP/1.1\r\nHost: here\r\n\r\n");
}

class HttpEndpointTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto endpoint = HttpEndpoint::Start("127.0.0.1:0", metrics_, [this] { return ready_.load(); });
    ASSERT_TRUE(endpoint.ok()) << endpoint.status();
    endpoint_ = *std::move(endpoint);
  }

  Metrics metrics_;
  std::atomic<bool> ready_{true};
  std::unique_ptr<HttpEndpoint> endpoint_;
};

TEST_F(HttpEndpointTest, MetricsAreServedAsPrometheusReadsThem) {
  metrics_.Refused(Refusal::kBadToken).Increment(3);
  const std::string answer = Get(endpoint_->address(), "/metrics");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(answer, HasSubstr("Content-Type: text/plain; version=0.0.4"));
  EXPECT_THAT(answer, HasSubstr("\nvoxelpipe_refused_total{reason=\"bad_token\"} 3\n"));
}

TEST_F(HttpEndpointTest, ReadinessFollowsTheServerAndLivenessDoesNot) {
  std::string error;
  EXPECT_EQ(HttpStatusOf(endpoint_->address(), "/readyz", 5000, error), 200) << error;
  ready_ = false;
  EXPECT_EQ(HttpStatusOf(endpoint_->address(), "/readyz", 5000, error), 503) << error;
  EXPECT_EQ(HttpStatusOf(endpoint_->address(), "/livez", 5000, error), 200) << error;
}

TEST_F(HttpEndpointTest, NothingElseIsServed) {
  for (const char* path : {"/", "/etc/passwd", "/../../etc/passwd", "/metrics/x", "/livezz"}) {
    EXPECT_THAT(Get(endpoint_->address(), path), StartsWith("HTTP/1.1 404")) << path;
  }
  EXPECT_THAT(Talk(endpoint_->address(), "POST /metrics HTTP/1.1\r\nHost: here\r\nContent-Length: 0\r\n\r\n"),
              StartsWith("HTTP/1.1 405"));
  EXPECT_THAT(Talk(endpoint_->address(), "PUT /x HTTP/1.1\r\nHost: here\r\nContent-Length: 0\r\n\r\n"),
              StartsWith("HTTP/1.1 405"));
}

TEST_F(HttpEndpointTest, AnAddressThatIsTakenOrNoneIsRefused) {
  EXPECT_EQ(HttpEndpoint::Start(endpoint_->address(), metrics_, [] { return true; }).status().code(),
            absl::StatusCode::kUnavailable);
  for (const char* address : {"", "here", "127.0.0.1:80s", "127.0.0.1:99999", "1,2"}) {
    EXPECT_EQ(HttpEndpoint::Start(address, metrics_, [] { return true; }).status().code(),
              absl::StatusCode::kInvalidArgument)
        << address;
  }
}

// The limit distinguishes waiting for slow connections from being served beside them.
TEST_F(HttpEndpointTest, SlowConnectionsKeepNobodyFromBeingAnswered) {
  std::vector<std::unique_ptr<Connection>> slow;
  for (int i = 0; i < 500; ++i) {
    slow.push_back(std::make_unique<Connection>(endpoint_->address()));
    ASSERT_TRUE(slow.back()->open());
    ASSERT_TRUE(i % 2 == 1 || slow.back()->Say("GET /livez HTT"));  // every other one says nothing
  }
  std::string error;
  EXPECT_EQ(HttpStatusOf(endpoint_->address(), "/livez", 1500, error), 200) << error;
}

TEST_F(HttpEndpointTest, AnAnswerHasABodyWhereItWasAskedFor) {
  EXPECT_THAT(Get(endpoint_->address(), "/livez"), EndsWith("\r\n\r\nok\n"));
  EXPECT_THAT(Talk(endpoint_->address(), "HEAD /livez HTTP/1.1\r\nHost: here\r\n\r\n"), EndsWith("\r\n\r\n"));
}

TEST_F(HttpEndpointTest, NobodyThereIsSaid) {
  const std::string address = endpoint_->address();
  endpoint_.reset();
  std::string error;
  EXPECT_EQ(HttpStatusOf(address, "/readyz", 5000, error), 0);
  EXPECT_FALSE(error.empty());
}

}  // namespace
}  // namespace voxelpipe
