#include "encode/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <utility>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr char kMark[] = ".part-";  // then the process and a number: PID-N

absl::Status SystemError(int error, const std::string& what) {
  return absl::ErrnoToStatus(error, what);
}

}  // namespace

absl::StatusOr<AtomicFile> AtomicFile::Create(const std::string& path) {
  static std::atomic<uint64_t> counter{0};
  AtomicFile file;
  file.path_ = path;
  file.temporary_ = absl::StrCat(path, kMark, getpid(), "-", counter.fetch_add(1));
  file.descriptor_ = open(file.temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file.descriptor_ < 0) return SystemError(errno, absl::StrCat("cannot create '", path, "'"));
  return file;
}

std::string AtomicFile::FinalPath(const std::string& temporary) {
  const size_t mark = temporary.rfind(kMark);
  if (mark == std::string::npos || mark == 0) return "";
  const std::string tail = temporary.substr(mark + sizeof(kMark) - 1);
  const size_t dash = tail.find('-');
  const auto is_number = [](const std::string& text) {
    return !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
  };
  const bool ours = dash != std::string::npos && is_number(tail.substr(0, dash)) && is_number(tail.substr(dash + 1));
  return ours ? temporary.substr(0, mark) : "";
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : path_(std::move(other.path_)),
      temporary_(std::move(other.temporary_)),
      descriptor_(std::exchange(other.descriptor_, -1)) {
  other.temporary_.clear();
}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) close(descriptor_);
  if (!temporary_.empty()) unlink(temporary_.c_str());
}

absl::Status AtomicFile::Write(std::span<const uint8_t> bytes, const JobContext* job) {
  constexpr size_t kPiece = size_t{8} << 20;
  while (!bytes.empty()) {
    if (job != nullptr) {
      if (absl::Status status = job->Check(); !status.ok()) return status;
    }
    const ssize_t written = write(descriptor_, bytes.data(), std::min(bytes.size(), kPiece));
    if (written < 0) {
      if (errno == EINTR) continue;
      return SystemError(errno, absl::StrCat("cannot write '", path_, "'"));
    }
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

absl::Status AtomicFile::Commit() {
  // Some file systems (quotas, network) report a failed write only here.
  if (close(std::exchange(descriptor_, -1)) != 0) return SystemError(errno, absl::StrCat("cannot write '", path_, "'"));
  if (std::rename(temporary_.c_str(), path_.c_str()) != 0) {
    return SystemError(errno, absl::StrCat("cannot create '", path_, "'"));
  }
  temporary_.clear();
  return absl::OkStatus();
}

}  // namespace voxelpipe
