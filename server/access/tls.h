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

// Nothing for plain text. Errors: INVALID_ARGUMENT naming the option, for files that cannot be read or hold no PEM, a
// key that does not belong to the certificate, one without the other.
absl::StatusOr<std::optional<TlsFacts>> CheckTlsFiles(const TlsFiles& files);

// What the port shows. gRPC gets no file before all of them have been found good: copies stand in memory, and gRPC
// reads those. Must outlive the server that has its credentials. ReloadIfChanged from one thread, all else from any.
class ServerTls {
 public:
  // Errors: those of CheckTlsFiles.
  static absl::StatusOr<std::unique_ptr<ServerTls>> Open(TlsFiles files, Metrics& metrics);
  ~ServerTls();
  ServerTls(const ServerTls&) = delete;
  ServerTls& operator=(const ServerTls&) = delete;

  // Plain text, or TLS 1.2 and 1.3 with the certificate; with client_ca, clients must show a certificate that it
  // signed.
  std::shared_ptr<grpc::ServerCredentials> Credentials() const;
  // Of the certificate that is shown; nothing for plain text.
  std::optional<TlsFacts> facts() const;
  // Looks at the files. Changed and good ones are shown within a second, to handshakes from then on; of others the last
  // good ones stay. Either is logged and counted, once a change.
  void ReloadIfChanged();

 private:
  // Of certificate, key and client_ca.
  using Contents = std::array<std::string, 3>;
  ServerTls(TlsFiles files, Metrics& metrics) : files_(std::move(files)), metrics_(metrics) {}
  absl::StatusOr<TlsFacts> Take(const Contents& contents);

  const TlsFiles files_;
  Metrics& metrics_;
  std::array<int, 3> copies_{-1, -1, -1};  // descriptors of memory
  Contents seen_;                          // that were read last, valid or not
  bool starved_ = false;                   // and lacked descriptors or memory: to be tried again
  mutable std::mutex mutex_;
  std::optional<TlsFacts> facts_;
};

}  // namespace voxelpipe
