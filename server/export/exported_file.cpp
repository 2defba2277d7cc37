#include "export/exported_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <filesystem>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "encode/atomic_file.h"
#include "observe/log.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::milliseconds kLookInterval{50};

}  // namespace

absl::StatusOr<std::shared_ptr<ExportedFile>> ExportedFile::Create(const OutputFormat& format, ByteBudget& files) {
  absl::StatusOr<TemporaryFolder> folder = TemporaryFolder::Create();
  if (!folder.ok()) return WithoutPaths(folder.status());
  return std::make_shared<ExportedFile>(format, files, *std::move(folder));
}

ExportedFile::Growth::Growth(ExportedFile& file, JobContext& job) : file_(file) {
  thread_ = std::thread([this, &job] {
    std::unique_lock lock(mutex_);
    while (!stopping_.wait_for(lock, kLookInterval, [this] { return stop_; })) {
      if (Charge()) continue;
      too_large_ = true;
      job.Cancel();
      return;
    }
  });
}

ExportedFile::Growth::~Growth() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  stopping_.notify_all();
  thread_.join();
}

bool ExportedFile::Growth::Charge() {
  const uint64_t bytes = file_.folder.Bytes();
  return bytes <= file_.share_.bytes() || file_.share_.TryGrow(bytes - file_.share_.bytes());
}

absl::Status ExportedFile::Growth::Check() {
  const std::lock_guard lock(mutex_);
  return too_large_ || !Charge() ? FileTooLarge(file_.max_bytes()) : absl::OkStatus();
}

absl::StatusOr<ExportedFile::Open> ExportedFile::Take() {
  Open file;
  file.name = std::filesystem::path(path).filename().string();
  file.descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat facts {};
  if (file.descriptor < 0 || fstat(file.descriptor, &facts) != 0) {
    const int error = errno;
    if (file.descriptor >= 0) close(file.descriptor);
    return WithoutPaths(OutputError(error, absl::StrCat("cannot read '", path, "'")));
  }
  file.bytes = uint64_t(facts.st_size);
  folder.Remove();
  share_.ShrinkTo(file.bytes);
  return file;
}

absl::Status WithoutPaths(absl::Status status) {
  if (!IsOutputError(status)) return status;
  LogMessage(LogLevel::kWarn, absl::StrCat("export: ", std::string(status.message())));
  return absl::Status(status.code(), "the server cannot write its temporary file; its log has the reason");
}

absl::Status FileTooLarge(uint64_t max_bytes) {
  return absl::ResourceExhaustedError(
      absl::StrCat("the file does not fit into what is left of --export-bytes, ", BytesText(max_bytes), " in all"));
}

}  // namespace voxelpipe
