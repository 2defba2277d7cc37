#include "export/temporary_folder.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/zip_writer.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;

constexpr size_t kCopyBytes = 1 << 20;

// All files below `folder`, in the order of their names.
std::vector<fs::path> FilesIn(const std::string& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::recursive_directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    std::error_code gone;  // writers rename their files meanwhile
    if (at->is_regular_file(gone)) files.push_back(at->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

absl::Status CopyInto(ZipWriter& zip, const fs::path& file, const std::string& name) {
  std::error_code error;
  const uint64_t bytes = fs::file_size(file, error);
  std::ifstream in(file, std::ios::binary);
  if (error || !in) return OutputError(EIO, absl::StrCat("cannot read '", file.string(), "'"));
  if (absl::Status s = zip.BeginEntry(name, bytes); !s.ok()) return s;
  std::vector<char> block(size_t(std::min<uint64_t>(bytes, kCopyBytes)));
  while (in.read(block.data(), std::streamsize(block.size())) || in.gcount() > 0) {
    const std::span<const uint8_t> got(reinterpret_cast<const uint8_t*>(block.data()), size_t(in.gcount()));
    if (absl::Status s = zip.Write(got); !s.ok()) return s;
    if (block.empty()) break;
  }
  return zip.EndEntry();
}

}  // namespace

absl::StatusOr<TemporaryFolder> TemporaryFolder::Create() {
  std::error_code error;
  const fs::path below = fs::temp_directory_path(error);
  std::string path = ((error ? fs::path("/tmp") : below) / "voxelpiped-XXXXXX").string();
  if (mkdtemp(path.data()) == nullptr) return OutputError(errno, absl::StrCat("cannot create '", path, "'"));
  return TemporaryFolder(std::move(path));
}

TemporaryFolder::~TemporaryFolder() {
  Remove();
}

void TemporaryFolder::Remove() {
  std::error_code error;
  if (!path_.empty()) fs::remove_all(std::exchange(path_, ""), error);
}

uint64_t TemporaryFolder::Bytes() const {
  uint64_t sum = 0;
  for (const fs::path& file : FilesIn(path_)) {
    std::error_code error;
    const uint64_t bytes = fs::file_size(file, error);
    if (!error) sum += bytes;
  }
  return sum;
}

absl::StatusOr<std::string> TemporaryFolder::OneFile(const std::string& name, const JobContext& job) const {
  const std::vector<fs::path> files = FilesIn(path_);
  if (files.size() == 1 && files[0].parent_path() == path_) return files[0].string();
  const std::string path = (fs::path(path_) / (name + ".zip")).string();
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(path, &job);
  if (!file.ok()) return file.status();
  ZipWriter zip(*file, &job);
  for (const fs::path& each : files) {
    if (absl::Status s = CopyInto(zip, each, each.lexically_relative(path_).generic_string()); !s.ok()) return s;
  }
  absl::Status s = zip.Finish();
  if (s.ok()) s = file->Commit();
  if (!s.ok()) return s;
  return path;
}

}  // namespace voxelpipe
