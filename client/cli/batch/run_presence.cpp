#include "batch/run_presence.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <sstream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "batch/done_record.h"
#include "batch/inside.h"
#include "encode/atomic_file.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// No output begins with the record directory's name, so no record is in this directory below it.
std::string RunDirectory(const std::string& output_dir) {
  return (fs::path(output_dir) / kRecordDirectory / kRecordDirectory).string();
}

std::string FirstLine(const char* path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

// Process numbers mean the same where these are equal: the start of the system, and the set of processes (a container
// has its own).
std::string ProcessSpace() {
  std::error_code ignored;
  return absl::StrCat(FirstLine("/proc/sys/kernel/random/boot_id"), " ",
                      fs::read_symlink("/proc/self/ns/pid", ignored).string());
}

// When a process began, in the system's ticks; empty if that is not to be seen. A number is used again, but not with
// it.
std::string StartOf(int64_t process) {
  const std::string text = FirstLine(absl::StrCat("/proc/", process, "/stat").c_str());
  const size_t name_end = text.rfind(')');  // the name may hold spaces
  if (name_end == std::string::npos) return "";
  std::istringstream fields(text.substr(name_end + 1));
  std::string field;
  for (int i = 0; i < 20; ++i) fields >> field;  // the 22nd of all
  return field;
}

bool IsProcessAlive(int64_t process, const std::string& start) {
  if (kill(pid_t(process), 0) != 0 && errno == ESRCH) return false;
  const std::string now = StartOf(process);
  return now.empty() || now == start;
}

std::string RandomId() {
  std::random_device random;
  std::string id;
  for (int i = 0; i < 4; ++i) absl::StrAppend(&id, absl::StrFormat("%08x", random()));
  return id;
}

bool IsId(const std::string& name) {
  return name.size() == 32 && name.find_first_not_of("0123456789abcdef") == std::string::npos;
}

struct RunFile {
  json owner{};  // discarded if it is not JSON
  std::chrono::nanoseconds time{};
};

// The file is opened, as that makes a network file system ask its server.
std::optional<RunFile> ReadRunFile(const std::string& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (descriptor < 0) return std::nullopt;
  struct stat status {};
  std::array<char, 4096> text{};
  const bool is_file = fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode);
  const ssize_t count = is_file ? read(descriptor, text.data(), text.size()) : 0;
  close(descriptor);
  if (!is_file) return std::nullopt;
  RunFile file;
  file.owner = json::parse(text.data(), text.data() + std::max<ssize_t>(0, count), nullptr, /*allow_exceptions=*/false);
  file.time = std::chrono::seconds(status.st_mtim.tv_sec) + std::chrono::nanoseconds(status.st_mtim.tv_nsec);
  return file;
}

}  // namespace

RunPresence::RunPresence(std::string directory, std::string id)
    : directory_(std::move(directory)), id_(std::move(id)) {}

RunPresence::RunPresence(RunPresence&& other) noexcept
    : directory_(std::move(other.directory_)), id_(std::exchange(other.id_, "")) {}

RunPresence::~RunPresence() {
  if (id_.empty()) return;
  RemoveDeadRuns();  // some were not known to be dead at the beginning
  unlink(PathOf(id_).c_str());
  rmdir(directory_.c_str());  // fails while other runs are in it
}

absl::StatusOr<RunPresence> RunPresence::Begin(const std::string& output_dir) {
  const std::string directory = RunDirectory(output_dir);
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) return absl::ErrnoToStatus(error.value(), absl::StrCat("cannot create '", directory, "'"));
  RunPresence run(directory, RandomId());
  if (absl::Status s = CheckInside(output_dir, run.PathOf(run.id_)); !s.ok()) return s;
  if (absl::Status s = run.WriteFile(); !s.ok()) return s;
  run.RemoveDeadRuns();
  return run;
}

std::string RunPresence::PathOf(const std::string& id) const {
  return absl::StrCat(directory_, "/", id);
}

absl::Status RunPresence::WriteFile() const {
  std::array<char, 256> host{};
  static_cast<void>(gethostname(host.data(), host.size() - 1));
  const json owner = {
      {"host", host.data()}, {"space", ProcessSpace()}, {"process", getpid()}, {"start", StartOf(getpid())}};
  const std::string text = owner.dump(-1, ' ', true, json::error_handler_t::replace) + "\n";
  std::error_code ignored;  // creating the file reports the error
  fs::create_directories(directory_, ignored);
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(PathOf(id_));
  if (!file.ok()) return file.status();
  if (absl::Status s = file->Write({reinterpret_cast<const uint8_t*>(text.data()), text.size()}); !s.ok()) return s;
  return file->Commit();
}

void RunPresence::Beat() const {
  if (utimensat(AT_FDCWD, PathOf(id_).c_str(), nullptr, AT_SYMLINK_NOFOLLOW) == 0) return;
  static_cast<void>(WriteFile());  // someone removed it; without it other runs may do the same items
}

bool RunPresence::IsAlive(const std::string& id) const {
  if (id == id_) return true;
  if (!IsId(id)) return false;
  const std::optional<RunFile> other = ReadRunFile(PathOf(id));
  if (!other) return false;
  if (other->owner.is_object() && other->owner.value("space", json()) == ProcessSpace()) {
    const json process = other->owner.value("process", json()), start = other->owner.value("start", json());
    if (process.is_number_integer() && start.is_string()) {
      return IsProcessAlive(process.get<int64_t>(), start.get<std::string>());
    }
  }
  const std::optional<RunFile> own = ReadRunFile(PathOf(id_));
  return !own || own->time - other->time <= kLease;
}

void RunPresence::RemoveDeadRuns() const {
  std::error_code ignored;
  for (fs::directory_iterator at(directory_, ignored), end; !ignored && at != end; at.increment(ignored)) {
    const std::string name = at->path().filename().string();
    if (IsId(name) && !IsAlive(name)) unlink(at->path().c_str());
    // A run that was killed while it made its file.
    const std::string stem = fs::path(AtomicFile::StemOf(at->path().string())).filename().string();
    std::error_code gone;
    const auto age = fs::file_time_type::clock::now() - at->last_write_time(gone);
    if (IsId(stem) && stem != id_ && !gone && age > kLease) unlink(at->path().c_str());
  }
}

}  // namespace voxelpipe::cli
