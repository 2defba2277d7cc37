// A server with a page, for the tests of its port.
#pragma once

#include <chrono>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/http_get.h"
#include "service/support/messages.h"
#include "service/support/server_process.h"
#include "service/support/web_client.h"
#include "support/json/json.h"
#include "support/resources/temporary_directory.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe::testing {

// True if it becomes true while a test waits.
inline bool BecomesTrue(const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() >= deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

class WebServerTest : public ::testing::Test {
 protected:
  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--web-listen", "127.0.0.1:0", "--http-listen", "127.0.0.1:0"});
    server_ = StartServer(arguments, folder_ + "/server.log");
    ASSERT_NE(server_, nullptr);
    const auto web = server_->web_address(), http = server_->http_address();
    ASSERT_TRUE(web.ok() && http.ok()) << web.status() << http.status();
    web_ = *web;
    http_ = *http;
  }

  double Sample(const std::string& name) { return SampleOf(HttpGet(http_, "/metrics"), name); }
  std::string Log() const {
    std::ifstream file(folder_ + "/server.log");
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }
  bool Logs(const std::string& text) const {
    return BecomesTrue([&] { return Log().find(text) != std::string::npos; });
  }

  static v1::VoxelizeRequest Message(const std::vector<uint8_t>& mesh, const VoxelizeRequest& request) {
    return RequestOf(request, mesh);
  }

  const TemporaryDirectory directory_;
  const std::string folder_ = directory_.path().string();
  std::string web_, http_;
  std::unique_ptr<ServerProcess> server_;
};

class TokenServerTest : public WebServerTest {
 protected:
  // Clients "farm" and "few" (two calls), and a monitor "eye".
  void StartWithTokens(std::vector<std::string> more = {}) {
    std::ofstream(folder_ + "/tokens.json") << R"({"clients": [
      {"name": "farm", "role": "user", "token": "token-of-the-farm"},
      {"name": "few", "role": "user", "token": "token-of-the-few", "calls_per_second": 0.001, "burst_calls": 2},
      {"name": "eye", "role": "monitor", "token": "token-of-the-eye"}]})";
    more.insert(more.end(), {"--token-file", folder_ + "/tokens.json", "--log-format", "json"});
    ASSERT_NO_FATAL_FAILURE(Start(more));
  }
  int StatusOf(const std::string& method, const HttpHeaders& headers, std::string_view message = "") {
    return CallWeb(web_, method, message, headers).status;
  }
  // The line "call" of the log with this id.
  nlohmann::json CallLine(const std::string& id) {
    EXPECT_TRUE(Logs("\"request\":\"" + id + "\"") || Logs("\"request\": \"" + id + "\"")) << Log();
    std::istringstream lines(Log());
    for (std::string line; std::getline(lines, line);) {
      nlohmann::json parsed = ParseJson(line, false);
      if (parsed.is_object() && parsed.value("request", "") == id) return parsed;
    }
    return {};
  }
};

}  // namespace voxelpipe::testing
