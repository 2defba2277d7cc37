// TLS and mTLS of the gRPC port.
#pragma once

#include <array>
#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include <grpcpp/security/server_credentials.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "observe/metrics.h"

namespace voxelpipe {

// PEM files. All empty: plain text. client_ca empty: clients need no certificate.
struct TlsFiles {
  std::string certificate, key, client_ca;
};

// The outcome of a check of the files.
struct TlsFacts {
  std::chrono::system_clock::time_point valid_from, valid_until;  // of the server's own certificate
};

// Empty for plain text. Errors: INVALID_ARGUMENT naming the option, for files that cannot be read or are not PEM, a key
// that does not match the certificate, one without the other.
absl::StatusOr<std::optional<TlsFacts>> CheckTlsFiles(const TlsFiles& files);

// The certificates of the port. gRPC reads copies in memory, which are replaced only after all files were validated.
// Must outlive the server with its credentials. ReloadIfChanged from one thread, everything else from any.
class ServerTls {
 public:
  // Errors: those of CheckTlsFiles.
  static absl::StatusOr<std::unique_ptr<ServerTls>> Open(TlsFiles files, Metrics& metrics);
  ~ServerTls();
  ServerTls(const ServerTls&) = delete;
  ServerTls& operator=(const ServerTls&) = delete;

  // Plain text, or TLS 1.2 and 1.3 with the certificate; with client_ca, clients must present a certificate signed by
  // it.
  std::shared_ptr<grpc::ServerCredentials> Credentials() const;
  // Validity of the current certificate; empty for plain text.
  std::optional<TlsFacts> facts() const;
  // Checks the files. Changed and valid ones take effect within a second, for later handshakes; if they are invalid,
  // the last valid ones stay. Both are logged and counted, once a change.
  void ReloadIfChanged();

 private:
  // Of certificate, key and client_ca.
  using Contents = std::array<std::string, 3>;
  ServerTls(TlsFiles files, Metrics& metrics) : files_(std::move(files)), metrics_(metrics) {}
  absl::StatusOr<TlsFacts> Take(const Contents& contents);

  const TlsFiles files_;
  Metrics& metrics_;
  std::array<int, 3> copies_{-1, -1, -1};  // memory files
  Contents seen_;                          // read last, valid or not
  bool starved_ = false;                   // true: the last read lacked descriptors or memory, and is retried
  mutable std::mutex mutex_;
  std::optional<TlsFacts> facts_;
};

}  // namespace voxelpipe
