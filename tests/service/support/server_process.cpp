#include "service/support/server_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

extern char** environ;

namespace voxelpipe::testing {
namespace {

using Clock = std::chrono::steady_clock;

struct Child {
  pid_t pid = -1;
  int output = -1;  // read end of its stdout
};

// This build's server, or the one that the environment names.
std::string ServerProgram() {
  const char* other = std::getenv("VOXELPIPE_TEST_SERVER");
  return other != nullptr ? other : VOXELPIPED_PATH;
}

absl::StatusOr<Child> Spawn(std::string program, const std::vector<std::string>& arguments,
                            const std::string& log_path = "") {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return absl::InternalError(absl::StrCat("pipe: ", std::strerror(errno)));
  std::vector<std::string> copies = arguments;
  std::vector<char*> argv{program.data()};
  for (std::string& argument : copies) argv.push_back(argument.data());
  argv.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  if (!log_path.empty()) {
    constexpr mode_t kForTheOwner = 0600;
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log_path.c_str(), O_WRONLY | O_CREAT | O_APPEND,
                                     kForTheOwner);
  }
  pid_t pid = -1;
  const int error = posix_spawn(&pid, program.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  if (error != 0) {
    close(ends[0]);
    return absl::InternalError(absl::StrCat(program, ": ", std::strerror(error)));
  }
  return Child{pid, ends[0]};
}

// Appends what comes within the time to `text`. False at the end of the stream or of the time.
bool ReadSome(int fd, Clock::time_point deadline, std::string& text) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
  pollfd wait{fd, POLLIN, 0};
  if (left <= 0 || poll(&wait, 1, int(left)) <= 0) return false;
  char buffer[4096];
  const ssize_t n = read(fd, buffer, sizeof buffer);
  if (n <= 0) return false;
  text.append(buffer, size_t(n));
  return true;
}

int ExitCode(int wait_status) {
  return WIFSIGNALED(wait_status) ? 128 + WTERMSIG(wait_status) : WEXITSTATUS(wait_status);
}

}  // namespace

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::Start(const std::vector<std::string>& arguments,
                                                                    const std::string& log_path) {
  return StartProgram(ServerProgram(), arguments, log_path);
}

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::StartFaulty(const std::string& fault_file,
                                                                          const std::vector<std::string>& arguments) {
  setenv("VOXELPIPE_TEST_FAULTS", fault_file.c_str(), /*overwrite=*/1);
  return StartProgram(FAULTY_VOXELPIPED_PATH, arguments, "");
}

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::StartProgram(const std::string& program,
                                                                           const std::vector<std::string>& arguments,
                                                                           const std::string& log_path) {
  std::vector<std::string> all;
  if (std::find(arguments.begin(), arguments.end(), "--listen") == arguments.end()) all = {"--listen", "127.0.0.1:0"};
  all.insert(all.end(), arguments.begin(), arguments.end());
  absl::StatusOr<Child> child = Spawn(program, all, log_path);
  if (!child.ok()) return child.status();
  std::unique_ptr<ServerProcess> server(new ServerProcess);
  server->pid_ = child->pid;
  server->stdout_ = child->output;
  absl::StatusOr<std::string> address = server->ReadLine("listening on ");
  if (!address.ok()) return address.status();
  server->address_ = *std::move(address);
  return server;
}

absl::StatusOr<std::string> ServerProcess::ReadLine(const std::string& start) {
  const auto deadline = Clock::now() + kPatience;
  for (;;) {
    const size_t at = output_.starts_with(start) ? 0 : output_.find("\n" + start);
    const size_t end = at == std::string::npos ? at : output_.find('\n', at + 1);
    if (end != std::string::npos) {
      const size_t begin = at + start.size() + (at == 0 ? 0 : 1);
      return output_.substr(begin, end - begin);
    }
    if (!ReadSome(stdout_, deadline, output_)) {
      return absl::InternalError(absl::StrCat("no '", start, "...' of voxelpiped; stdout so far: '", output_, "'"));
    }
  }
}

absl::StatusOr<std::string> ServerProcess::http_address() {
  return ReadLine("http on ");
}

absl::StatusOr<std::string> ServerProcess::web_address() {
  return ReadLine("web on http://");
}

ServerProcess::~ServerProcess() {
  if (IsRunning()) {
    Signal(SIGKILL);
    Reap(/*block_until_dead=*/true);
  }
  if (stdout_ >= 0) close(stdout_);
}

void ServerProcess::Signal(int signal) {
  if (!exit_code_) kill(pid_, signal);
}

bool ServerProcess::Reap(bool block_until_dead) {
  if (exit_code_) return true;
  int status = 0;
  if (waitpid(pid_, &status, block_until_dead ? 0 : WNOHANG) != pid_) return false;
  exit_code_ = ExitCode(status);
  return true;
}

bool ServerProcess::IsRunning() {
  return !Reap(/*block_until_dead=*/false);
}

absl::StatusOr<CommandResult> ServerProcess::Wait(std::chrono::milliseconds timeout) {
  const auto deadline = Clock::now() + timeout;
  while (ReadSome(stdout_, deadline, output_)) {}
  // The stream has ended, so the process is ending, or the time is over.
  while (!Reap(/*block_until_dead=*/false)) {
    if (Clock::now() >= deadline) return absl::DeadlineExceededError("voxelpiped still runs");
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return CommandResult{*exit_code_, output_};
}

absl::StatusOr<CommandResult> RunVoxelpiped(const std::vector<std::string>& arguments) {
  absl::StatusOr<Child> child = Spawn(ServerProgram(), arguments);
  if (!child.ok()) return child.status();
  CommandResult result;
  const auto deadline = Clock::now() + kPatience;
  while (ReadSome(child->output, deadline, result.output)) {}
  close(child->output);
  int status = 0;
  while (waitpid(child->pid, &status, WNOHANG) != child->pid) {
    if (Clock::now() >= deadline) {
      kill(child->pid, SIGKILL);
      waitpid(child->pid, &status, 0);
      return absl::DeadlineExceededError("voxelpiped did not come to an end");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  result.exit_code = ExitCode(status);
  return result;
}

std::unique_ptr<ServerProcess> StartServer(const std::vector<std::string>& arguments, const std::string& log_path) {
  // Between its calls only gRPC's backup poller polls the connection of a blocking client, every five seconds. A
  // draining server would wait that long for the GOAWAY of such a client.
  setenv("GRPC_CLIENT_CHANNEL_BACKUP_POLL_INTERVAL_MS", "100", /*overwrite=*/0);
  absl::StatusOr<std::unique_ptr<ServerProcess>> server = ServerProcess::Start(arguments, log_path);
  EXPECT_TRUE(server.ok()) << server.status();
  return server.ok() ? *std::move(server) : nullptr;
}

std::unique_ptr<Client> ConnectTo(const ServerProcess& server) {
  ConnectOptions options;
  options.timeout = kPatience;
  options.retries = 0;  // tests want the first outcome
  absl::StatusOr<std::unique_ptr<Client>> client = Client::Connect(server.address(), options);
  EXPECT_TRUE(client.ok()) << client.status();
  return client.ok() ? *std::move(client) : nullptr;
}

}  // namespace voxelpipe::testing
