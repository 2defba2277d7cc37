#include "observe/unix_socket.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

static_assert(kMaxUnixPathBytes == sizeof(sockaddr_un::sun_path) - 1);

constexpr char kSocket[] = "/socket", kAside[] = "/aside";  // in the folder

// In: a descriptor of a socket's file. Out: 0, or the error of a connection to it.
int TryToConnect(int file) {
  sockaddr_un at{};
  at.sun_family = AF_UNIX;
  std::snprintf(at.sun_path, sizeof at.sun_path, "/proc/self/fd/%d", file);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return errno;
  const int error = connect(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0 ? 0 : errno;
  close(fd);
  return error;
}

}  // namespace

std::string UnixPathOf(const std::string& address) {
  const std::string text = address.substr(sizeof(kUnixScheme) - 1);
  std::string path;
  for (size_t i = 0; i < text.size(); ++i) {
    const bool escape = text[i] == '%' && i + 2 < text.size() && absl::ascii_isxdigit(uint8_t(text[i + 1])) &&
                        absl::ascii_isxdigit(uint8_t(text[i + 2]));
    path += escape ? absl::HexStringToBytes(text.substr(i + 1, 2)) : text.substr(i, 1);
    if (escape) i += 2;
  }
  return path;
}

UnixSocket::UnixSocket(std::string address) : address_(std::move(address)) {}

absl::StatusOr<std::unique_ptr<UnixSocket>> UnixSocket::Prepare(const std::string& address) {
  std::unique_ptr<UnixSocket> it(new UnixSocket(address));
  const std::string path = UnixPathOf(address);
  const size_t slash = path.rfind('/');
  const std::string directory = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  it->name_ = path.substr(slash + 1);
  if (it->name_.empty()) return it->Failure("it is a directory");
  it->directory_ = open(directory.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
  if (it->directory_ < 0) return it->Failure(absl::StrCat(directory, ": ", std::strerror(errno)));
  if (const auto abandoned = it->IsAbandoned(it->name_); !abandoned.ok()) return abandoned.status();
  if (absl::Status s = it->MakeFolder(); !s.ok()) return s;
  return it;
}

absl::Status UnixSocket::Failure(const std::string& reason) const {
  return absl::UnavailableError(absl::StrCat("cannot listen on ", address_, ": ", reason));
}

// Short, however long the path of the directory is.
std::string UnixSocket::In(const std::string& name) const {
  return absl::StrCat("/proc/self/fd/", directory_, "/", name);
}

absl::Status UnixSocket::MakeFolder() {
  std::string folder = In(".voxelpiped-XXXXXX");
  if (mkdtemp(folder.data()) == nullptr) return Failure(absl::StrCat("no socket can be made: ", std::strerror(errno)));
  folder_ = folder.substr(In("").size());
  return absl::OkStatus();
}

std::string UnixSocket::private_address() const {
  return kUnixScheme + In(folder_ + kSocket);
}

absl::StatusOr<bool> UnixSocket::IsAbandoned(const std::string& name) const {
  const int file = openat(directory_, name.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC);
  if (file < 0) return errno == ENOENT ? absl::StatusOr<bool>(false) : Failure(std::strerror(errno));
  struct stat found {};
  const bool is_socket = fstat(file, &found) == 0 && S_ISSOCK(found.st_mode);
  const int error = is_socket ? TryToConnect(file) : 0;
  close(file);
  if (!is_socket) return Failure("there is something other than a socket; remove it");
  switch (error) {
    case 0:
    case EAGAIN: return Failure("a server listens there");  // EAGAIN: it is slow to accept
    case ECONNREFUSED: return true;
    default:
      return Failure(absl::StrCat("there is a socket that cannot be asked for its server: ", std::strerror(error)));
  }
}

absl::Status UnixSocket::RemoveAbandoned() {
  const absl::StatusOr<bool> abandoned = IsAbandoned(name_);
  if (!abandoned.ok()) return abandoned.status();
  if (!*abandoned) return absl::OkStatus();
  // Another server may take the path at any time. So the socket is moved aside and tried again there.
  const std::string aside = folder_ + kAside;
  if (renameat(directory_, name_.c_str(), directory_, aside.c_str()) != 0) {
    return errno == ENOENT ? absl::OkStatus() : Failure(std::strerror(errno));
  }
  const absl::StatusOr<bool> still = IsAbandoned(aside);
  if (still.ok()) {
    unlinkat(directory_, aside.c_str(), 0);
    return absl::OkStatus();
  }
  renameat2(directory_, aside.c_str(), directory_, name_.c_str(), RENAME_NOREPLACE);
  return still.status();
}

absl::Status UnixSocket::Publish() {
  constexpr int kAttempts = 3;
  const std::string made = folder_ + kSocket;
  struct stat status {};
  if (fstatat(directory_, made.c_str(), &status, AT_SYMLINK_NOFOLLOW) != 0) return Failure(std::strerror(errno));
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    if (absl::Status s = RemoveAbandoned(); !s.ok()) return s;
    int moved = renameat2(directory_, made.c_str(), directory_, name_.c_str(), RENAME_NOREPLACE);
    if (moved != 0 && (errno == EINVAL || errno == ENOSYS)) {  // a file system without this flag
      moved = renameat(directory_, made.c_str(), directory_, name_.c_str());
    }
    if (moved != 0 && errno == EEXIST) continue;
    if (moved != 0) break;
    device_ = status.st_dev;
    inode_ = status.st_ino;
    unlinkat(directory_, std::exchange(folder_, "").c_str(), AT_REMOVEDIR);
    return absl::OkStatus();
  }
  return Failure(std::strerror(errno));
}

UnixSocket::~UnixSocket() {
  if (!folder_.empty()) {
    unlinkat(directory_, (folder_ + kSocket).c_str(), 0);
    unlinkat(directory_, (folder_ + kAside).c_str(), 0);
    unlinkat(directory_, folder_.c_str(), AT_REMOVEDIR);
  }
  struct stat found {};
  if (inode_ != 0 && fstatat(directory_, name_.c_str(), &found, AT_SYMLINK_NOFOLLOW) == 0 && found.st_dev == device_ &&
      found.st_ino == inode_) {
    unlinkat(directory_, name_.c_str(), 0);
  }
  if (directory_ >= 0) close(directory_);
}

}  // namespace voxelpipe
