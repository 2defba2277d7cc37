#include "isolate/shared_region.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kPage = 4096;

}  // namespace

absl::StatusOr<SharedRegion> SharedRegion::Create() {
  SharedRegion region(memfd_create("voxelpipe-load", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  if (region.fd_ < 0) return absl::ErrnoToStatus(errno, "memfd_create");
  if (ftruncate(region.fd_, off_t(kBytes)) != 0) return absl::ErrnoToStatus(errno, "ftruncate of a memory file");
  if (fcntl(region.fd_, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) != 0) {
    return absl::ErrnoToStatus(errno, "sealing a memory file");
  }
  return region;
}

SharedRegion::~SharedRegion() {
  if (data_ != nullptr) munmap(data_, mapped_);
  if (fd_ >= 0) close(fd_);
}

absl::StatusOr<uint8_t*> SharedRegion::Map(uint64_t bytes) {
  if (bytes <= mapped_ && data_ != nullptr) return data_;
  if (bytes > kBytes) return absl::ResourceExhaustedError(absl::StrCat(bytes, " bytes are more than can be shared"));
  // In steps, so that it is rarely mapped again.
  uint64_t length = std::max<uint64_t>(bytes, 1 << 20);
  length = std::min(kBytes, (length + length / 4 + kPage - 1) / kPage * kPage);
  void* const data = mmap(nullptr, length, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0);
  if (data == MAP_FAILED) return absl::ResourceExhaustedError(absl::StrCat("no memory to share ", bytes, " bytes"));
  if (data_ != nullptr) munmap(data_, mapped_);
  data_ = static_cast<uint8_t*>(data);
  mapped_ = length;
  return data_;
}

uint64_t SharedRegion::resident_bytes() const {
  struct stat facts {};
  if (fstat(fd_, &facts) != 0) return 0;
  return uint64_t(facts.st_blocks) * 512;
}

void SharedRegion::ShrinkTo(uint64_t bytes) {
  const uint64_t begin = (bytes + kPage - 1) / kPage * kPage;
  if (begin >= kBytes) return;
  fallocate(fd_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, off_t(begin), off_t(kBytes - begin));
}

}  // namespace voxelpipe
