// The real command line tool, running until a test stops it.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>
#include <vector>

extern char** environ;

namespace voxelpipe::testing {

// Its output is discarded. Killed at the latest by the destructor.
class CliProcess {
 public:
  explicit CliProcess(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), VOXELPIPE_CLI);
    std::vector<char*> argv;
    argv.reserve(arguments.size() + 1);
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    for (const int descriptor : {STDOUT_FILENO, STDERR_FILENO}) {
      posix_spawn_file_actions_addopen(&actions, descriptor, "/dev/null", O_WRONLY, 0);
    }
    if (posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ) != 0) pid_ = -1;
    posix_spawn_file_actions_destroy(&actions);
  }
  ~CliProcess() {
    Signal(SIGKILL);
    Wait();
  }
  CliProcess(const CliProcess&) = delete;
  CliProcess& operator=(const CliProcess&) = delete;

  bool IsRunning() { return pid_ > 0 && !Reap(WNOHANG); }
  void Signal(int signal) {
    if (IsRunning()) kill(pid_, signal);
  }
  // Its exit code, or -signal if a signal ended it.
  int Wait() {
    if (pid_ > 0) Reap(0);
    return exit_code_;
  }

 private:
  bool Reap(int options) {
    int status = 0;
    if (waitpid(pid_, &status, options) != pid_) return false;
    exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    pid_ = -1;
    return true;
  }

  pid_t pid_ = -1;
  int exit_code_ = -1;
};

}  // namespace voxelpipe::testing
