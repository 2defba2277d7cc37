#include "check_files.h"

#include "absl/strings/str_cat.h"
#include "access/tokens.h"

namespace voxelpipe {

TlsFiles TlsOf(const ServerOptions& options) {
  return {options.tls_cert, options.tls_key, options.tls_client_ca};
}

absl::Status CheckFiles(const ServerOptions& options) {
  if (absl::Status status = CheckTlsFiles(TlsOf(options)).status(); !status.ok()) return status;
  if (options.tls_client_names && options.tls_client_ca.empty()) {
    return absl::InvalidArgumentError(
        "--tls-client-names: needs --tls-client-ca: unverified certificates identify no client");
  }
  if (options.token_file.empty()) return absl::OkStatus();
  absl::Status status = TokenTable::Read(options.token_file).status();
  if (status.ok()) return status;
  return absl::Status(status.code(), absl::StrCat("--token-file: ", status.message()));
}

}  // namespace voxelpipe
