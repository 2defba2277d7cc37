// A pseudo-terminal, for programs that ask if they write to one.
#pragma once

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include <string>

namespace voxelpipe::testing {

class Terminal {
 public:
  Terminal() : descriptor_(posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK)) {
    if (descriptor_ < 0 || grantpt(descriptor_) != 0 || unlockpt(descriptor_) != 0) return;
    path_ = ptsname(descriptor_);
    kept_open_ = open(path_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);  // what was shown stays readable
  }
  ~Terminal() {
    close(kept_open_);
    close(descriptor_);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  // For redirections; empty if the system gives no terminal.
  const std::string& path() const { return path_; }
  // What was shown since the last call; at most some kilobytes are kept.
  std::string Shown() {
    std::string text;
    char piece[4096];
    for (ssize_t got; (got = read(descriptor_, piece, sizeof piece)) > 0;) text.append(piece, size_t(got));
    return text;
  }

 private:
  int descriptor_ = -1, kept_open_ = -1;
  std::string path_;
};

}  // namespace voxelpipe::testing
