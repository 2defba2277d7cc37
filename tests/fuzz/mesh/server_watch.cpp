#include "fuzz/mesh/server_watch.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "absl/strings/str_cat.h"

extern char** environ;

namespace voxelpipe::fuzz {
namespace {

constexpr std::chrono::seconds kPatience{60};

// The address in "listening on HOST:PORT", or an empty text.
std::string AddressIn(const std::string& output) {
  constexpr char kStart[] = "listening on ";
  const size_t at = output.find(kStart), end = output.find('\n', at);
  if (at == std::string::npos || end == std::string::npos) return "";
  const size_t begin = at + sizeof kStart - 1;
  return output.substr(begin, end - begin);
}

uint64_t ResidentBytesOf(pid_t pid) {
  std::ifstream file(absl::StrCat("/proc/", pid, "/statm"));
  uint64_t total = 0, resident = 0;
  file >> total >> resident;
  return resident * uint64_t(sysconf(_SC_PAGESIZE));
}

std::vector<pid_t> ChildrenOf(pid_t pid) {
  std::ifstream file(absl::StrCat("/proc/", pid, "/task/", pid, "/children"));
  std::vector<pid_t> children;
  for (pid_t child = 0; file >> child;) children.push_back(child);
  return children;
}

}  // namespace

absl::StatusOr<std::unique_ptr<ServerWatch>> ServerWatch::Start(const std::string& program,
                                                                std::vector<std::string> arguments,
                                                                const std::string& log_path) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return absl::ErrnoToStatus(errno, "pipe");
  arguments.insert(arguments.begin(), {program, "--listen", "127.0.0.1:0"});
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  std::unique_ptr<ServerWatch> server(new ServerWatch());
  server->output_ = ends[0];
  const int error = posix_spawnp(&server->pid_, program.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  if (error != 0) {
    server->pid_ = -1;
    return absl::ErrnoToStatus(error, program);
  }
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  for (std::string output; std::chrono::steady_clock::now() < deadline;) {
    pollfd wait{server->output_, POLLIN, 0};
    if (poll(&wait, 1, 100) <= 0) continue;
    char buffer[4096];
    const ssize_t got = read(server->output_, buffer, sizeof buffer);
    if (got <= 0) break;
    output.append(buffer, size_t(got));
    server->address_ = AddressIn(output);
    if (!server->address_.empty()) return server;
  }
  return absl::UnavailableError(absl::StrCat(program, " does not serve; its log is ", log_path));
}

ServerWatch::~ServerWatch() {
  if (pid_ > 0 && ended_.empty()) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  if (output_ >= 0) close(output_);
}

std::string ServerWatch::Ended() {
  int status = 0;
  if (ended_.empty() && waitpid(pid_, &status, WNOHANG) == pid_) {
    ended_ = WIFSIGNALED(status) ? absl::StrCat("signal ", WTERMSIG(status))
                                 : absl::StrCat("exit code ", WEXITSTATUS(status));
  }
  return ended_;
}

uint64_t ServerWatch::ResidentBytes() const {
  uint64_t bytes = ResidentBytesOf(pid_);
  for (const pid_t child : ChildrenOf(pid_)) bytes += ResidentBytesOf(child);
  return bytes;
}

}  // namespace voxelpipe::fuzz
