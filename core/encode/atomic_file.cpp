#include "encode/atomic_file.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <thread>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "encode/output_path.h"

namespace voxelpipe {
namespace {

constexpr char kMark[] = ".part-";      // followed by the process id and a number: PID-N
constexpr size_t kMaxSuffixBytes = 32;  // of the mark and the numbers
constexpr char kOutputUrl[] = "voxelpipe/output_error";
constexpr std::chrono::milliseconds kPollInterval{50};  // poll interval of the job while a FIFO waits for a reader

// True if the file is written in place: it is not a regular file, or has no path (an open file's link in /proc).
bool IsWrittenThrough(const struct stat& status, const std::string& final_path) {
  if (!S_ISREG(status.st_mode)) return true;
  struct stat named {};
  return stat(final_path.c_str(), &named) != 0 || named.st_ino != status.st_ino || named.st_dev != status.st_dev;
}

// Opens for writing; a FIFO opens only once it has a reader.
absl::StatusOr<int> OpenThrough(const std::string& path, const JobContext* job) {
  for (;;) {
    // Non-blocking, so that the wait for a reader sees the end of the job.
    const int descriptor = open(path.c_str(), O_WRONLY | O_TRUNC | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (descriptor >= 0) return descriptor;
    struct stat status {};
    const bool no_reader = errno == ENXIO && stat(path.c_str(), &status) == 0 && S_ISFIFO(status.st_mode);
    if (!no_reader && errno != EINTR) return OutputError(errno, absl::StrCat("cannot write '", path, "'"));
    if (job != nullptr) {
      if (absl::Status over = job->Check(); !over.ok()) return over;
    }
    std::this_thread::sleep_for(kPollInterval);
  }
}

// Copies mode and owner of the previous file, as far as the system allows.
void TakeOver(int descriptor, const struct stat& was) {
  struct stat is {};
  if (fstat(descriptor, &is) != 0) return;
  mode_t kept = 07777;
  if ((was.st_uid != is.st_uid || was.st_gid != is.st_gid) && fchown(descriptor, was.st_uid, was.st_gid) != 0) {
    kept = 0777;  // no set-user-id bit for another owner
  }
  static_cast<void>(fchmod(descriptor, was.st_mode & kept));
}

}  // namespace

absl::Status AsOutputError(absl::Status status) {
  status.SetPayload(kOutputUrl, absl::Cord());
  return status;
}

absl::Status OutputError(int error, const std::string& what) {
  absl::Status status = absl::ErrnoToStatus(error, what);
  status.SetPayload(kOutputUrl, absl::Cord(absl::StrCat(error)));
  return status;
}

bool IsOutputError(const absl::Status& status) {
  return status.GetPayload(kOutputUrl).has_value();
}

int OutputErrno(const absl::Status& status) {
  const absl::optional<absl::Cord> payload = status.GetPayload(kOutputUrl);
  int number = 0;
  return payload && absl::SimpleAtoi(std::string(*payload), &number) ? number : 0;
}

absl::StatusOr<AtomicFile> AtomicFile::Create(const std::string& path, const JobContext* job) {
  AtomicFile file;
  file.path_ = path;
  absl::StatusOr<std::string> final_path = FollowLinks(path);
  if (!final_path.ok()) return AsOutputError(final_path.status());
  file.final_path_ = *std::move(final_path);
  struct stat status {};
  const bool exists = stat(path.c_str(), &status) == 0;
  if (exists && S_ISDIR(status.st_mode)) return OutputError(EISDIR, absl::StrCat("cannot create '", path, "'"));
  if (exists && IsWrittenThrough(status, file.final_path_)) {
    const absl::StatusOr<int> descriptor = OpenThrough(path, job);
    if (!descriptor.ok()) return descriptor.status();
    file.descriptor_ = *descriptor;
    return file;
  }
  std::string temporary;
  do {  // a killed process may have left this name, or someone a link
    temporary = TemporaryName(file.final_path_);
    file.descriptor_ = open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  } while (file.descriptor_ < 0 && errno == EEXIST);
  if (file.descriptor_ < 0) return OutputError(errno, absl::StrCat("cannot create '", path, "'"));
  file.temporary_ = std::move(temporary);
  if (exists) TakeOver(file.descriptor_, status);
  return file;
}

absl::StatusOr<AtomicFile> AtomicFile::StandardOutput() {
  AtomicFile file;
  file.path_ = "standard output";
  file.descriptor_ = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 0);  // Commit closes its own descriptor only
  if (file.descriptor_ < 0) return OutputError(errno, "cannot write 'standard output'");
  return file;
}

std::string AtomicFile::TemporaryName(const std::string& path) {
  static std::atomic<uint64_t> counter{0};
  return absl::StrCat(TemporaryStem(path), kMark, getpid(), "-", counter.fetch_add(1));
}

std::string AtomicFile::TemporaryStem(const std::string& path) {
  return FitFileName(path, kMaxSuffixBytes);
}

std::string AtomicFile::StemOf(const std::string& temporary) {
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
      final_path_(std::move(other.final_path_)),
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
      if (errno == EAGAIN) {  // the reader of a FIFO is slow
        pollfd ready{descriptor_, POLLOUT, 0};
        poll(&ready, 1, int(kPollInterval.count()));
        continue;
      }
      return OutputError(errno, absl::StrCat("cannot write '", path_, "'"));
    }
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

absl::Status AtomicFile::WriteAt(uint64_t offset, std::span<const uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = pwrite(descriptor_, bytes.data(), bytes.size(), off_t(offset));
    if (written < 0) {
      if (errno == EINTR) continue;
      return OutputError(errno, absl::StrCat("cannot write '", path_, "'"));
    }
    offset += uint64_t(written);
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

absl::Status AtomicFile::Commit() {
  // Some file systems (quotas, network) report a failed write only here.
  if (close(std::exchange(descriptor_, -1)) != 0) return OutputError(errno, absl::StrCat("cannot write '", path_, "'"));
  if (temporary_.empty()) return absl::OkStatus();
  if (std::rename(temporary_.c_str(), final_path_.c_str()) != 0) {
    return OutputError(errno, absl::StrCat("cannot create '", path_, "'"));
  }
  temporary_.clear();
  return absl::OkStatus();
}

}  // namespace voxelpipe
