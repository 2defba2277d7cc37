#include "encode/read/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace voxelpipe {

absl::StatusOr<std::shared_ptr<const InputFile>> InputFile::Open(const std::string& path) {
  // A FIFO without a writer would block.
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) {
    if (errno == ENOENT) return absl::NotFoundError(absl::StrCat(path, ": no such file"));
    return absl::UnavailableError(absl::StrCat(path, ": cannot be read: ", std::strerror(errno)));
  }
  struct stat about {};
  const bool regular = fstat(descriptor, &about) == 0 && S_ISREG(about.st_mode);
  std::shared_ptr<const InputFile> file(new InputFile(path, descriptor, uint64_t(about.st_size)));  // closes it
  if (!regular) return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  return file;
}

InputFile::~InputFile() {
  close(descriptor_);
}

absl::Status InputFile::ReadAt(uint64_t offset, std::span<uint8_t> out) const {
  for (size_t done = 0; done < out.size();) {
    const ssize_t got = pread(descriptor_, out.data() + done, out.size() - done, off_t(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) {
      return absl::UnavailableError(
          absl::StrCat(path_, ": byte ", offset + done, ": cannot be read: ", std::strerror(errno)));
    }
    if (got == 0) return absl::DataLossError(absl::StrCat(path_, ": ends at byte ", offset + done));
    done += size_t(got);
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
