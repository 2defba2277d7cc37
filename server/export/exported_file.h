// A result as a file of an output format, in a folder of its own until it is sent.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/warning.h"
#include "encode/format_registry.h"
#include "export/temporary_folder.h"
#include "schedule/byte_budget.h"

namespace voxelpipe {

// Shared by the job that writes it and the call that sends it: the folder lives until both are done with it.
class ExportedFile {
 public:
  // `files`: the budget of all such files, in bytes; must outlive the object. The system's error if there can be no
  // folder, without its path.
  static absl::StatusOr<std::shared_ptr<ExportedFile>> Create(const OutputFormat& format, ByteBudget& files);
  ExportedFile(const OutputFormat& of, ByteBudget& files, TemporaryFolder in)
      : format(of), folder(std::move(in)), files_(files), share_(files) {}

  // Charges the size of the files in the folder while they are written, by code that knows no limit, and cancels their
  // job if that is not possible. Lives as long as the writer.
  class Growth {
   public:
    Growth(ExportedFile& file, JobContext& job);
    ~Growth();
    Growth(const Growth&) = delete;
    Growth& operator=(const Growth&) = delete;

    // Looks once more, after the last byte was written. RESOURCE_EXHAUSTED if the files were too large at any time.
    absl::Status Check();

   private:
    bool Charge();

    ExportedFile& file_;
    std::atomic<bool> too_large_{false};
    std::mutex mutex_;
    std::condition_variable stopping_;
    bool stop_ = false;
    std::thread thread_;
  };

  struct Open {
    int descriptor = -1;  // of the caller, who closes it
    uint64_t bytes = 0;
    std::string name;  // without the path
  };
  // Opens the complete file and removes the folder: the file ends with its descriptor, its charge with this object.
  // Once.
  absl::StatusOr<Open> Take();

  uint64_t max_bytes() const { return files_.limit(); }  // of all files at the same time

  const OutputFormat& format;
  TemporaryFolder folder;
  // Once the job has ended with OK:
  std::string path;      // of the complete file
  WarningList warnings;  // of what the format does not hold

 private:
  ByteBudget& files_;
  BudgetShare share_;  // the bytes of the files
};

// What a caller may know of an error: the system's error in a file of this machine goes to the log, and comes back
// without its path.
absl::Status WithoutPaths(absl::Status status);

// RESOURCE_EXHAUSTED: the file exceeds what is left of `max_bytes`.
absl::Status FileTooLarge(uint64_t max_bytes);

}  // namespace voxelpipe
