// A real voxelpiped for a test: its own process, its own port. VOXELPIPE_TEST_SERVER in the environment names another
// binary than that of this build, for example one with a sanitizer, while the tests themselves stay fast.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "client.h"
#include "support/slowdown.h"

namespace voxelpipe::testing {

// The limit of every wait of these tests; long enough for a loaded machine.
inline constexpr std::chrono::seconds kPatience{60 * kSlowdown};

// The outcome of a finished command.
struct CommandResult {
  int exit_code = -1;  // 128 + signal if a signal ended it
  std::string output;  // stdout
};

// Runs voxelpiped with these arguments to its end. DEADLINE_EXCEEDED (and a kill) after kPatience.
absl::StatusOr<CommandResult> RunVoxelpiped(const std::vector<std::string>& arguments);

class ServerProcess {
 public:
  // Starts voxelpiped, on a free loopback port unless `arguments` have --listen, and waits for its address. Its log
  // goes to the file `log_path`, or to this process's stderr.
  static absl::StatusOr<std::unique_ptr<ServerProcess>> Start(const std::vector<std::string>& arguments = {},
                                                              const std::string& log_path = "");
  // The same with a device "cuda:0" that breaks as `fault_file` says (support/faulty_backend.h), read again before
  // every run.
  static absl::StatusOr<std::unique_ptr<ServerProcess>> StartFaulty(const std::string& fault_file,
                                                                    const std::vector<std::string>& arguments);
  // Kills the process if it still runs.
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  const std::string& address() const { return address_; }  // 127.0.0.1:PORT, or that of --listen
  // The address of --http-listen, which must have been given.
  absl::StatusOr<std::string> http_address();
  // The same of --web-listen.
  absl::StatusOr<std::string> web_address();
  pid_t pid() const { return pid_; }

  // SIGTERM, or another signal.
  void Signal(int signal);
  // Waits for the process to end. Out: exit code, and all of its stdout.
  absl::StatusOr<CommandResult> Wait(std::chrono::milliseconds timeout = kPatience);
  bool IsRunning();

 private:
  ServerProcess() = default;
  static absl::StatusOr<std::unique_ptr<ServerProcess>> StartProgram(const std::string& program,
                                                                     const std::vector<std::string>& arguments,
                                                                     const std::string& log_path);
  bool Reap(bool block_until_dead);
  // Waits for the line of stdout that begins with `start`. Out: the rest of the line.
  absl::StatusOr<std::string> ReadLine(const std::string& start);

  pid_t pid_ = -1;
  int stdout_ = -1;
  std::string output_, address_;
  std::optional<int> exit_code_;
};

// Starts a server and fails the test if it does not come up.
std::unique_ptr<ServerProcess> StartServer(const std::vector<std::string>& arguments = {},
                                           const std::string& log_path = "");
// A client of it; fails the test if it cannot connect.
std::unique_ptr<Client> ConnectTo(const ServerProcess& server);

}  // namespace voxelpipe::testing
