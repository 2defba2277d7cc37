#include "check_files.h"

#include "absl/strings/str_cat.h"
#include "access/tokens.h"
#include "web/http/origin_rules.h"

namespace voxelpipe {

TlsFiles TlsOf(const ServerOptions& options) {
  return {options.tls_cert, options.tls_key, options.tls_client_ca};
}

absl::Status CheckWebOptions(const ServerOptions& options) {
  const auto origins = ParseOrigins(options.web_origin);
  if (!origins.ok()) return absl::InvalidArgumentError(absl::StrCat("--web-origin: ", origins.status().message()));
  if (!options.web_listen.empty() && !options.tls_client_ca.empty() && options.token_file.empty()) {
    return absl::InvalidArgumentError(
        "--web-listen: needs --token-file beside --tls-client-ca: browsers show no certificate there, so that anyone "
        "could call");
  }
  return absl::OkStatus();
}

absl::Status CheckFiles(const ServerOptions& options) {
  if (absl::Status status = CheckWebOptions(options); !status.ok()) return status;
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
