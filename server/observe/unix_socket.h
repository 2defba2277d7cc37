// The path of a unix socket that gRPC listens on.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe {

inline constexpr char kUnixScheme[] = "unix:";
inline constexpr size_t kMaxUnixPathBytes = 107;  // sockaddr_un holds one byte more, for the end of the string

// In: an address "unix:PATH". Out: PATH, percent-decoded, as gRPC reads it.
std::string UnixPathOf(const std::string& address);

// gRPC removes whatever socket is at its path, before it listens there and after it has closed: also that of another
// server. So it listens at a path of its own, and this class gives the socket its name, and takes it back.
class UnixSocket {
 public:
  // In: an address "unix:PATH", not longer than kMaxUnixPathBytes. Errors: UNAVAILABLE if a server answers at the path,
  // if something other than a socket is there, or if the system lets no socket be made beside it.
  static absl::StatusOr<std::unique_ptr<UnixSocket>> Prepare(const std::string& address);
  // Removes the socket, if it still is at the path and not another one. gRPC may have closed it before.
  ~UnixSocket();
  UnixSocket(const UnixSocket&) = delete;
  UnixSocket& operator=(const UnixSocket&) = delete;

  // The address for gRPC to listen on.
  std::string private_address() const;
  // Call once, when gRPC listens: from now on the socket is at its path, in place of one that no server has any more.
  // Errors: those of Prepare; of two servers that start at the same time, one gets them.
  absl::Status Publish();

 private:
  explicit UnixSocket(std::string address);
  absl::Status MakeFolder();
  // Errors of Prepare for what is at the path. Out: true if an abandoned socket is.
  absl::StatusOr<bool> IsAbandoned(const std::string& name) const;
  absl::Status RemoveAbandoned();
  absl::Status Failure(const std::string& reason) const;
  std::string In(const std::string& name) const;  // the path of a name in the directory, by its descriptor

  const std::string address_;
  std::string name_;    // in the directory
  int directory_ = -1;  // descriptor of the directory of the path
  std::string folder_;  // in the directory: of this server alone; empty if there is none
  dev_t device_ = 0;    // of the published socket
  ino_t inode_ = 0;     // 0: none is
};

}  // namespace voxelpipe
