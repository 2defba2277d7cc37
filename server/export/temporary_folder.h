// A folder for the files of one result.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

class TemporaryFolder {
 public:
  // A new folder below the system's for temporary files ($TMPDIR, otherwise /tmp) that only this user may enter. The
  // system's error with the path.
  static absl::StatusOr<TemporaryFolder> Create();
  // Removes it with all that is in it.
  ~TemporaryFolder();
  TemporaryFolder(TemporaryFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  TemporaryFolder& operator=(TemporaryFolder&&) = delete;

  const std::string& path() const { return path_; }
  // Removes it now. Open files stay until they are closed.
  void Remove();
  // Of all files in it, also while others write them.
  uint64_t Bytes() const;
  // The path of its only entry, if that is a file; otherwise of a new archive with all of them, whose name is `name`
  // and ".zip".
  absl::StatusOr<std::string> OneFile(const std::string& name, const JobContext& job) const;

 private:
  explicit TemporaryFolder(std::string path) : path_(std::move(path)) {}

  std::string path_;
};

}  // namespace voxelpipe
