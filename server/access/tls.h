// TLS and mTLS of the gRPC port.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include <grpcpp/security/server_credentials.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe {

// PEM files. All empty: plain text. client_ca empty: clients need no certificate.
struct TlsFiles {
  std::string certificate, key, client_ca;
};

// What a look at the files says.
struct TlsFacts {
  std::chrono::system_clock::time_point valid_from, valid_until;  // of the server's own certificate
};

// Nothing for plain text. Errors: INVALID_ARGUMENT naming the option, for files that cannot be read or hold no PEM, a key that does
// not belong to the certificate, one without the other.
absl::StatusOr<std::optional<TlsFacts>> CheckTlsFiles(const TlsFiles& files);

// Plain text, or TLS 1.2 and 1.3 with the files' certificate; with client_ca, clients must show a certificate that it signed. The
// files are read again every `reload_interval` (at least a second); handshakes after that use what they hold then. Errors: those of
// CheckTlsFiles.
absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> MakeServerCredentials(
    const TlsFiles& files, std::chrono::milliseconds reload_interval);

}  // namespace voxelpipe
