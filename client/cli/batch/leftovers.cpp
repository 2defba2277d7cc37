#include "batch/leftovers.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <set>
#include <unordered_set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "batch/done_record.h"
#include "batch/inside.h"
#include "encode/atomic_file.h"
#include "encode/encode.h"
#include "encode/output_path.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;

// True if the open file is the one at this path.
bool IsAt(int descriptor, const std::string& path) {
  struct stat open_one {
  }, named{};
  return fstat(descriptor, &open_one) == 0 && lstat(path.c_str(), &named) == 0 && open_one.st_ino == named.st_ino &&
         open_one.st_dev == named.st_dev;
}

}  // namespace

void RemoveLeftovers(const std::string& output_dir, const std::vector<BatchItem>& items) {
  std::unordered_set<std::string> ours;
  std::set<fs::path> directories;
  const auto add = [&](const fs::path& path) {
    const absl::StatusOr<std::string> file = FollowLinks(path.string());
    if (!file.ok()) return;
    ours.insert(AtomicFile::TemporaryStem(*file));
    directories.insert(fs::path(*file).parent_path());
  };
  for (const BatchItem& item : items) {
    for (const std::string& name : WrittenPaths(item.output, item.request->request.targets.size())) {
      add(fs::path(output_dir) / name);
    }
    if (!item.preview.empty()) add(fs::path(output_dir) / item.preview);
    add(RecordPath(output_dir, item));
  }
  for (const fs::path& directory : directories) {
    // Batch does not write through links that leave the directory, so there are no temporary files behind them.
    if (!CheckInside(output_dir, (directory / "file").string()).ok()) continue;
    std::error_code ignored;  // a missing directory is empty
    for (fs::directory_iterator at(directory, ignored), end; !ignored && at != end; at.increment(ignored)) {
      const std::string path = at->path().string();
      const std::string stem = AtomicFile::StemOf(path);
      if (stem.empty() || !ours.contains(stem)) continue;
      std::error_code gone;
      fs::remove_all(path, gone);
    }
  }
}

absl::StatusOr<RunLock> RunLock::Take(const std::string& output_dir, const Shard& shard) {
  const fs::path directory = fs::path(output_dir) / kRecordDirectory;
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) return absl::ErrnoToStatus(error.value(), absl::StrCat("cannot create '", directory.string(), "'"));
  if (absl::Status s = CheckInside(output_dir, (directory / "record").string()); !s.ok()) return s;
  const std::string path = (directory / absl::StrCat("lock-", shard.index % shard.count, "-of-", shard.count)).string();
  for (;;) {
    // Who may write to the directory may have put a link there, to a file anywhere, or a FIFO.
    const int descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0666);
    if (descriptor < 0 && errno == ELOOP) {
      return absl::PermissionDeniedError(absl::StrCat(
          "'", path, "' is a link; batch does not follow it, and needs a file of its own there; remove it"));
    }
    if (descriptor < 0) return absl::ErrnoToStatus(errno, absl::StrCat("cannot create '", path, "'"));
    RunLock lock(path, descriptor);
    struct stat status {};
    if (fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
      lock.path_.clear();
      return absl::FailedPreconditionError(
          absl::StrCat("'", path, "' is not a regular file; batch locks only regular files"));
    }
    if (flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      lock.path_.clear();  // the other run removes it
      return absl::AbortedError(
          absl::StrCat("another run works on shard ", shard.index, "/", shard.count, " in '", output_dir, "'"));
    }
    if (IsAt(descriptor, path)) return lock;
    lock.path_.clear();  // the previous run removed the file while this one waited: lock the new one
  }
}

RunLock::RunLock(RunLock&& other) noexcept
    : path_(std::exchange(other.path_, "")), descriptor_(std::exchange(other.descriptor_, -1)) {}

RunLock::~RunLock() {
  if (!path_.empty()) unlink(path_.c_str());
  if (descriptor_ >= 0) close(descriptor_);
}

}  // namespace voxelpipe::cli
