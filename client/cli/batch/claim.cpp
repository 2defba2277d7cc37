#include "batch/claim.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
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

// The text of a symbolic link; empty and errno if it is none.
std::string TextOfLink(const std::string& path) {
  std::array<char, 256> text{};
  const ssize_t size = readlink(path.c_str(), text.data(), text.size());
  return size <= 0 ? "" : std::string(text.data(), size_t(size));
}

// Removes the claim of a dead run, unless another run has taken it over in the meantime.
void RemoveDeadClaim(const std::string& path, const std::string& dead) {
  const std::string aside = AtomicFile::TemporaryName(path);
  if (std::rename(path.c_str(), aside.c_str()) != 0) return;  // someone else did
  if (TextOfLink(aside) != dead) {
    // A new claim: back to its place. A run that takes the item in between writes the same bytes.
    static_cast<void>(link(aside.c_str(), path.c_str()));
  }
  unlink(aside.c_str());
}

}  // namespace

std::string ClaimPath(const std::string& output_dir, const BatchItem& item) {
  const std::string path = (fs::path(output_dir) / kRecordDirectory / item.output).string();
  return FitFileName(path, std::string(".claim").size()) + ".claim";
}

absl::StatusOr<std::optional<Claim>> Claim::Take(const std::string& output_dir, const BatchItem& item,
                                                 const RunPresence& run) {
  const std::string path = ClaimPath(output_dir, item);
  bool has_leftovers = false;
  for (;;) {
    if (symlink(run.id().c_str(), path.c_str()) == 0) {
      // Not before the item is ours: a run that took it over first may be writing it.
      if (has_leftovers) RemoveLeftovers(output_dir, item, run);
      return Claim(path, run.id());
    }
    const int error = errno;
    if (error == ENOENT) {
      std::error_code failed;
      fs::create_directories(fs::path(path).parent_path(), failed);
      if (!failed) continue;
      return OutputError(failed.value(), absl::StrCat("cannot create '", path, "'"));
    }
    if (error == EPERM || error == EOPNOTSUPP || error == ENOSYS) return Claim("", "");
    if (error != EEXIST) return OutputError(error, absl::StrCat("cannot create '", path, "'"));
    const std::string owner = TextOfLink(path);
    if (owner.empty() && errno == ENOENT) continue;  // just released
    if (owner.empty()) return OutputError(errno, absl::StrCat("'", path, "' is in the place of a claim; remove it"));
    if (owner == run.id()) return Claim(path, run.id());
    if (run.IsAlive(owner)) return std::nullopt;
    RemoveDeadClaim(path, owner);
    has_leftovers = true;
  }
}

bool Claim::IsTaken(const std::string& output_dir, const BatchItem& item, const RunPresence& run) {
  const std::string owner = TextOfLink(ClaimPath(output_dir, item));
  return !owner.empty() && owner != run.id() && run.IsAlive(owner);
}

void Claim::RemoveDead(const std::string& output_dir, const BatchItem& item, const RunPresence& run) {
  const std::string path = ClaimPath(output_dir, item);
  const std::string owner = TextOfLink(path);
  if (!owner.empty() && owner != run.id() && !run.IsAlive(owner)) RemoveDeadClaim(path, owner);
}

Claim::Claim(std::string path, std::string id) : path_(std::move(path)), id_(std::move(id)) {}

Claim::Claim(Claim&& other) noexcept : path_(std::exchange(other.path_, "")), id_(std::move(other.id_)) {}

Claim::~Claim() {
  if (!path_.empty() && TextOfLink(path_) == id_) unlink(path_.c_str());
}

void RemoveLeftovers(const std::string& output_dir, const BatchItem& item, const RunPresence& run) {
  std::unordered_set<std::string> ours;
  std::set<fs::path> directories;
  const auto add = [&](const fs::path& path) {
    const absl::StatusOr<std::string> file = FollowLinks(path.string());
    if (!file.ok()) return;
    ours.insert(AtomicFile::TemporaryStem(*file));
    directories.insert(fs::path(*file).parent_path());
  };
  for (const std::string& name : WrittenPaths(item.output, item.request->request.targets.size())) {
    add(fs::path(output_dir) / name);
  }
  if (!item.preview.empty()) add(fs::path(output_dir) / item.preview);
  add(RecordPath(output_dir, item));
  ours.insert(AtomicFile::TemporaryStem(ClaimPath(output_dir, item)));
  for (const fs::path& directory : directories) {
    // Batch does not write through links that leave the directory, so there are no temporary files behind them.
    if (!CheckInside(output_dir, (directory / "file").string()).ok()) continue;
    std::error_code ignored;  // a missing directory is empty
    for (fs::directory_iterator at(directory, ignored), end; !ignored && at != end; at.increment(ignored)) {
      const std::string path = at->path().string();
      const std::string stem = AtomicFile::StemOf(path);
      if (stem.empty() || !ours.contains(stem)) continue;
      const std::string owner = TextOfLink(path);  // of a claim that another run has moved aside for a moment
      if (!owner.empty() && (owner == run.id() || run.IsAlive(owner))) continue;
      std::error_code gone;
      fs::remove_all(path, gone);
    }
  }
}

}  // namespace voxelpipe::cli
