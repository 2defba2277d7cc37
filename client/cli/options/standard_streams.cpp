#include "options/standard_streams.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "absl/strings/str_cat.h"

namespace voxelpipe::cli {

std::string InputName(const std::string& path) {
  return IsStandardStream(path) ? "standard input" : path;
}

absl::Status CheckInputStream(const std::vector<std::string>& inputs) {
  const auto streams = std::count_if(inputs.begin(), inputs.end(), &IsStandardStream);
  if (streams > 1) return absl::InvalidArgumentError("'-' is standard input, which holds one mesh; give it once");
  if (streams == 0 || isatty(STDIN_FILENO) != 1) return absl::OkStatus();
  return absl::InvalidArgumentError(
      "'-' reads the mesh from standard input, which is a terminal; redirect it: '- < mesh.glb', or name the file");
}

absl::Status CheckStandardOutput() {
  if (isatty(STDOUT_FILENO) != 1) return absl::OkStatus();
  return absl::InvalidArgumentError(
      "--output: '-' is standard output, which is a terminal; redirect it: '-o - > out.npy', or name the file");
}

absl::StatusOr<FileBytes> ReadStandardInput(uint64_t max_bytes, const JobContext& job) {
  constexpr uint64_t kFirstBytes = uint64_t{1} << 20;
  constexpr int kPollMs = 50;  // read() would start again after a signal, and not see the end of the job
  FileBytes bytes;
  for (uint64_t size = 0;;) {
    if (absl::Status status = job.Check(); !status.ok()) return status;
    pollfd ready{STDIN_FILENO, POLLIN, 0};
    if (poll(&ready, 1, kPollMs) == 0) continue;
    if (size == bytes.size()) bytes.resize(std::min(std::max(kFirstBytes, 2 * size), max_bytes + 1));
    const ssize_t got = read(STDIN_FILENO, bytes.data() + size, bytes.size() - size);
    if (got < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (got < 0) return absl::ErrnoToStatus(errno, "cannot be read");
    size += uint64_t(got);
    if (size > max_bytes) {
      return absl::ResourceExhaustedError(absl::StrCat("more than ", max_bytes, " bytes, the limit"));
    }
    if (got > 0) continue;
    bytes.resize(size);
    return bytes;
  }
}

}  // namespace voxelpipe::cli
