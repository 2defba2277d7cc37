// Which runs of `voxelpipe batch` work in an output directory, on any host.
#pragma once

#include <chrono>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe::cli {

// A file in the output directory that says that this run works there: its name is the run's id, and Beat renews its
// time. Locks of the system are not used, as other hosts may not see them. The destructor removes it.
class RunPresence {
 public:
  // A run on another host whose file is older than this, by the clock of the file system, counts as dead.
  static constexpr std::chrono::seconds kLease{60}, kBeatInterval{10};

  // Creates the directory and the file. Files of runs that are dead are removed, now and at the end. PERMISSION_DENIED
  // if a link leads out of the output directory; otherwise the system's error with the path.
  static absl::StatusOr<RunPresence> Begin(const std::string& output_dir);
  RunPresence(RunPresence&& other) noexcept;
  RunPresence& operator=(RunPresence&&) = delete;
  ~RunPresence();

  // 32 hexadecimal digits that no other run has.
  const std::string& id() const { return id_; }

  // Renews the time of the file, or makes it again. Every kBeatInterval.
  void Beat() const;

  // True if the run with this id may still work: of this host and set of processes, if its process exists; of others,
  // if its file was renewed within kLease. A run without a file has ended.
  bool IsAlive(const std::string& id) const;

 private:
  RunPresence(std::string directory, std::string id);
  std::string PathOf(const std::string& id) const;
  absl::Status WriteFile() const;
  void RemoveDeadRuns() const;

  std::string directory_;
  std::string id_;  // empty once moved from
};

}  // namespace voxelpipe::cli
