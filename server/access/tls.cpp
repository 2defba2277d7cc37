#include "access/tls.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <algorithm>
#include <ctime>
#include <fstream>
#include <iterator>

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

using Bio = std::unique_ptr<BIO, decltype(&BIO_free)>;
using Certificate = std::unique_ptr<X509, decltype(&X509_free)>;
using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;

absl::Status Wrong(const char* option, const std::string& path, const char* what) {
  ERR_clear_error();
  return absl::InvalidArgumentError(absl::StrCat(option, ": ", path, " ", what));
}

absl::StatusOr<Bio> Open(const char* option, const std::string& path) {
  Bio bio(BIO_new_file(path.c_str(), "r"), &BIO_free);
  if (!bio) return Wrong(option, path, "cannot be read");
  return bio;
}

absl::StatusOr<Certificate> ReadCertificate(const char* option, const std::string& path) {
  absl::StatusOr<Bio> bio = Open(option, path);
  if (!bio.ok()) return bio.status();
  Certificate certificate(PEM_read_bio_X509(bio->get(), nullptr, nullptr, nullptr), &X509_free);
  if (!certificate) return Wrong(option, path, "holds no PEM certificate");
  return certificate;
}

std::chrono::system_clock::time_point ToTime(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return {};
  return std::chrono::system_clock::from_time_t(timegm(&parts));
}

// No pass phrase is asked for on a terminal.
int NoPassphrase(char*, int, int, void*) {
  return 0;
}

}  // namespace

absl::StatusOr<std::optional<TlsFacts>> CheckTlsFiles(const TlsFiles& files) {
  if (files.certificate.empty() != files.key.empty()) {
    return absl::InvalidArgumentError("--tls-cert and --tls-key: one is useless without the other");
  }
  if (files.certificate.empty()) {
    if (!files.client_ca.empty()) return absl::InvalidArgumentError("--tls-client-ca: needs --tls-cert and --tls-key");
    return std::nullopt;
  }
  const absl::StatusOr<Certificate> certificate = ReadCertificate("--tls-cert", files.certificate);
  if (!certificate.ok()) return certificate.status();
  absl::StatusOr<Bio> bio = Open("--tls-key", files.key);
  if (!bio.ok()) return bio.status();
  const Key key(PEM_read_bio_PrivateKey(bio->get(), nullptr, &NoPassphrase, nullptr), &EVP_PKEY_free);
  if (!key) return Wrong("--tls-key", files.key, "holds no PEM key without a pass phrase");
  if (X509_check_private_key(certificate->get(), key.get()) != 1) {
    return Wrong("--tls-key", files.key, "does not belong to the certificate");
  }
  if (!files.client_ca.empty()) {
    if (const auto ca = ReadCertificate("--tls-client-ca", files.client_ca); !ca.ok()) return ca.status();
  }
  return TlsFacts{ToTime(X509_get0_notBefore(certificate->get())), ToTime(X509_get0_notAfter(certificate->get()))};
}

absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> MakeServerCredentials(
    const TlsFiles& files, std::chrono::milliseconds reload_interval) {
  const absl::StatusOr<std::optional<TlsFacts>> facts = CheckTlsFiles(files);
  if (!facts.ok()) return facts.status();
  if (!facts->has_value()) return grpc::InsecureServerCredentials();
  namespace tls = grpc::experimental;
  const auto seconds = unsigned(std::max<int64_t>(1, reload_interval.count() / 1000));
  tls::TlsServerCredentialsOptions options(
      std::make_shared<tls::FileWatcherCertificateProvider>(files.key, files.certificate, files.client_ca, seconds));
  options.watch_identity_key_cert_pairs();
  if (!files.client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return tls::TlsServerCredentials(options);
}

}  // namespace voxelpipe
