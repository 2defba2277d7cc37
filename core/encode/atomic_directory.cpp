#include "encode/atomic_directory.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/output_path.h"

namespace voxelpipe {

namespace fs = std::filesystem;

absl::StatusOr<AtomicDirectory> AtomicDirectory::Create(const std::string& path, const std::string& mark) {
  AtomicDirectory directory;
  directory.path_ = path;
  directory.mark_ = mark;
  std::string named = path;
  while (named.size() > 1 && named.back() == '/') named.pop_back();
  absl::StatusOr<std::string> final_path = FollowLinks(named);
  if (!final_path.ok()) return AsOutputError(final_path.status());
  directory.final_path_ = *std::move(final_path);
  if (absl::Status s = directory.CheckPrevious(); !s.ok()) return s;
  std::string temporary;
  int made = 0;
  do {  // a killed process may have left this name, or someone a link
    temporary = AtomicFile::TemporaryName(directory.final_path_);
    made = mkdir(temporary.c_str(), 0777);
  } while (made != 0 && errno == EEXIST);
  if (made != 0) return OutputError(errno, absl::StrCat("cannot create '", path, "'"));
  directory.temporary_ = std::move(temporary);
  return directory;
}

AtomicDirectory::AtomicDirectory(AtomicDirectory&& other) noexcept
    : path_(std::move(other.path_)),
      final_path_(std::move(other.final_path_)),
      temporary_(std::exchange(other.temporary_, "")),
      mark_(std::move(other.mark_)) {}

AtomicDirectory::~AtomicDirectory() {
  std::error_code ignored;
  if (!temporary_.empty()) fs::remove_all(temporary_, ignored);
}

absl::Status AtomicDirectory::CheckPrevious() const {
  std::error_code error;
  const fs::file_status previous = fs::status(final_path_, error);
  if (previous.type() == fs::file_type::not_found) return absl::OkStatus();
  if (error) return OutputError(error.value(), absl::StrCat("cannot create '", path_, "'"));
  const bool ours = previous.type() == fs::file_type::directory &&
                    (fs::exists(fs::path(final_path_) / mark_, error) || fs::is_empty(final_path_, error));
  if (ours && !error) return absl::OkStatus();
  return AsOutputError(absl::AlreadyExistsError(
      absl::StrCat("cannot replace '", path_, "': it has no ", mark_, ", so it is no earlier result; remove it")));
}

absl::Status AtomicDirectory::WriteFile(const std::string& name, std::span<const uint8_t> bytes,
                                        const JobContext* job) const {
  const fs::path whole = fs::path(temporary_) / name;
  std::error_code ignored;  // creating the file reports the error
  fs::create_directories(whole.parent_path(), ignored);
  if (job != nullptr) {
    if (absl::Status s = job->Check(); !s.ok()) return s;
  }
  const std::string what = absl::StrCat("cannot write '", path_, "/", name, "'");
  const int descriptor = open(whole.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0666);
  if (descriptor < 0) return OutputError(errno, what);
  int error = 0;
  while (!bytes.empty() && error == 0) {
    const ssize_t written = write(descriptor, bytes.data(), bytes.size());
    if (written >= 0) {
      bytes = bytes.subspan(size_t(written));
    } else if (errno != EINTR) {
      error = errno;
    }
  }
  if (close(descriptor) != 0 && error == 0) error = errno;
  return error == 0 ? absl::OkStatus() : OutputError(error, what);
}

absl::Status AtomicDirectory::Commit() {
  if (absl::Status s = CheckPrevious(); !s.ok()) return s;
  const auto failed = [this] { return OutputError(errno, absl::StrCat("cannot create '", path_, "'")); };
  if (renameat2(AT_FDCWD, temporary_.c_str(), AT_FDCWD, final_path_.c_str(), RENAME_EXCHANGE) == 0) {
    return absl::OkStatus();  // the destructor removes the earlier one
  }
  if (errno != ENOENT) {  // a file system that cannot exchange: the name is missing for a moment
    const std::string earlier = AtomicFile::TemporaryName(final_path_);
    if (std::rename(final_path_.c_str(), earlier.c_str()) != 0 && errno != ENOENT) return failed();
    if (std::rename(temporary_.c_str(), final_path_.c_str()) != 0) {
      const absl::Status status = failed();
      static_cast<void>(std::rename(earlier.c_str(), final_path_.c_str()));
      return status;
    }
    temporary_ = earlier;
    return absl::OkStatus();
  }
  if (std::rename(temporary_.c_str(), final_path_.c_str()) != 0) return failed();
  temporary_.clear();
  return absl::OkStatus();
}

}  // namespace voxelpipe
