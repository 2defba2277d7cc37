#include "access/tls.h"

#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <ctime>
#include <fstream>

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include "absl/strings/str_cat.h"
#include "observe/log.h"

namespace voxelpipe {
namespace {

using Bio = std::unique_ptr<BIO, decltype(&BIO_free)>;
using Certificate = std::unique_ptr<X509, decltype(&X509_free)>;
using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;

absl::Status Wrong(const char* option, const std::string& path, const char* what) {
  ERR_clear_error();
  return absl::InvalidArgumentError(absl::StrCat(option, ": ", path, " ", what));
}

// The maximum size of a file: far more than any chain of certificates.
constexpr size_t kMaxFileBytes = 4 << 20;

constexpr std::array<const char*, 3> kOptions = {"--tls-cert", "--tls-key", "--tls-client-ca"};

const std::string& PathOf(const TlsFiles& files, size_t which) {
  return which == 0 ? files.certificate : which == 1 ? files.key : files.client_ca;
}

// Empty if there is none that can be read.
std::string ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text(kMaxFileBytes, '\0');
  file.read(text.data(), std::streamsize(text.size()));
  text.resize(size_t(file.gcount()));
  text.shrink_to_fit();  // it is kept
  return text;
}

std::array<std::string, 3> ReadFiles(const TlsFiles& files) {
  std::array<std::string, 3> contents;
  for (size_t i = 0; i < contents.size(); ++i) {
    if (const std::string& path = PathOf(files, i); !path.empty()) contents[i] = ReadFile(path);
  }
  return contents;
}

absl::StatusOr<Bio> Open(const char* option, const std::string& path, const std::string& text) {
  if (text.empty()) return Wrong(option, path, "cannot be read");
  return Bio(BIO_new_mem_buf(text.data(), int(text.size())), &BIO_free);
}

// The first certificate of a file in which all must be valid: gRPC accepts a file only as a whole.
absl::StatusOr<Certificate> ReadCertificate(const char* option, const std::string& path, const std::string& text) {
  absl::StatusOr<Bio> bio = Open(option, path, text);
  if (!bio.ok()) return bio.status();
  Certificate first(PEM_read_bio_X509(bio->get(), nullptr, nullptr, nullptr), &X509_free);
  if (!first) return Wrong(option, path, "holds no PEM certificate");
  while (Certificate(PEM_read_bio_X509(bio->get(), nullptr, nullptr, nullptr), &X509_free)) {}
  if (ERR_GET_REASON(ERR_peek_last_error()) != PEM_R_NO_START_LINE) {
    return Wrong(option, path, "holds a broken certificate behind a good one");
  }
  ERR_clear_error();
  return first;
}

std::chrono::system_clock::time_point ToTime(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return {};
  return std::chrono::system_clock::from_time_t(timegm(&parts));
}

// Never prompts for a pass phrase on a terminal.
int NoPassphrase(char*, int, int, void*) {
  return 0;
}

absl::StatusOr<TlsFacts> CheckContents(const TlsFiles& files, const std::array<std::string, 3>& contents) {
  const absl::StatusOr<Certificate> certificate = ReadCertificate(kOptions[0], files.certificate, contents[0]);
  if (!certificate.ok()) return certificate.status();
  absl::StatusOr<Bio> bio = Open(kOptions[1], files.key, contents[1]);
  if (!bio.ok()) return bio.status();
  const Key key(PEM_read_bio_PrivateKey(bio->get(), nullptr, &NoPassphrase, nullptr), &EVP_PKEY_free);
  if (!key) return Wrong(kOptions[1], files.key, "holds no PEM key without a pass phrase");
  if (X509_check_private_key(certificate->get(), key.get()) != 1) {
    return Wrong(kOptions[1], files.key, "does not belong to the certificate");
  }
  if (!files.client_ca.empty()) {
    if (const auto ca = ReadCertificate(kOptions[2], files.client_ca, contents[2]); !ca.ok()) return ca.status();
  }
  return TlsFacts{ToTime(X509_get0_notBefore(certificate->get())), ToTime(X509_get0_notAfter(certificate->get()))};
}

// True if TLS is on. Errors: options that require others.
absl::StatusOr<bool> HasTls(const TlsFiles& files) {
  if (files.certificate.empty() != files.key.empty()) {
    return absl::InvalidArgumentError("--tls-cert and --tls-key: each needs the other");
  }
  if (!files.certificate.empty()) return true;
  if (!files.client_ca.empty()) return absl::InvalidArgumentError("--tls-client-ca: needs --tls-cert and --tls-key");
  return false;
}

// A memory file with this text, -1 if the system has none.
int CopyOf(const std::string& text) {
  const int copy = memfd_create("voxelpiped-tls", MFD_CLOEXEC);
  for (size_t at = 0; copy >= 0 && at < text.size();) {
    const ssize_t written = write(copy, text.data() + at, text.size() - at);
    if (written <= 0) {
      close(copy);
      return -1;
    }
    at += size_t(written);
  }
  return copy;
}

// Duplicates `fresh` to the descriptor `copy`, atomically. Both are open, so only a signal or a concurrent open() can
// delay it.
bool Replace(int fresh, int copy) {
  int done;
  do {
    done = dup3(fresh, copy, O_CLOEXEC);
  } while (done < 0 && (errno == EINTR || errno == EBUSY));
  return done == copy;
}

std::string PathOfCopy(int descriptor) {
  return descriptor < 0 ? std::string() : absl::StrCat("/proc/self/fd/", descriptor);
}

}  // namespace

absl::StatusOr<std::optional<TlsFacts>> CheckTlsFiles(const TlsFiles& files) {
  const absl::StatusOr<bool> tls = HasTls(files);
  if (!tls.ok()) return tls.status();
  if (!*tls) return std::nullopt;
  const absl::StatusOr<TlsFacts> facts = CheckContents(files, ReadFiles(files));
  if (!facts.ok()) return facts.status();
  return *facts;
}

absl::StatusOr<std::unique_ptr<ServerTls>> ServerTls::Open(TlsFiles files, Metrics& metrics) {
  const absl::StatusOr<bool> has_tls = HasTls(files);
  if (!has_tls.ok()) return has_tls.status();
  std::unique_ptr<ServerTls> tls(new ServerTls(std::move(files), metrics));
  if (!*has_tls) return tls;
  tls->seen_ = ReadFiles(tls->files_);
  if (const auto facts = tls->Take(tls->seen_); !facts.ok()) return facts.status();
  return tls;
}

ServerTls::~ServerTls() {
  for (const int copy : copies_) {
    if (copy >= 0) close(copy);
  }
  OPENSSL_cleanse(seen_[1].data(), seen_[1].size());
}

absl::StatusOr<TlsFacts> ServerTls::Take(const Contents& contents) {
  absl::StatusOr<TlsFacts> facts = CheckContents(files_, contents);
  if (!facts.ok()) return facts.status();
  std::array<int, 3> fresh;
  bool have_all = true;
  for (size_t i = 0; i < fresh.size(); ++i) {
    fresh[i] = PathOf(files_, i).empty() ? -1 : CopyOf(contents[i]);
    have_all = have_all && (fresh[i] >= 0 || PathOf(files_, i).empty());
  }
  // Under the descriptors that gRPC reads.
  bool replaced = true;
  for (size_t i = 0; i < fresh.size(); ++i) {
    if (have_all && copies_[i] < 0) {
      copies_[i] = std::exchange(fresh[i], -1);
    } else if (have_all) {
      replaced = Replace(fresh[i], copies_[i]) && replaced;
    }
    if (fresh[i] >= 0) close(fresh[i]);
  }
  if (!have_all) return absl::ResourceExhaustedError("no descriptors or memory for the certificates");
  if (!replaced) return absl::InternalError("the certificates in use could not be replaced: restart the server");
  const std::lock_guard lock(mutex_);
  facts_ = *facts;
  return facts;
}

std::shared_ptr<grpc::ServerCredentials> ServerTls::Credentials() const {
  if (copies_[0] < 0) return grpc::InsecureServerCredentials();
  namespace tls = grpc::experimental;
  constexpr unsigned kLookSeconds = 1;  // gRPC's reload interval; its minimum
  tls::TlsServerCredentialsOptions options(std::make_shared<tls::FileWatcherCertificateProvider>(
      PathOfCopy(copies_[1]), PathOfCopy(copies_[0]), PathOfCopy(copies_[2]), kLookSeconds));
  options.watch_identity_key_cert_pairs();
  if (!files_.client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return tls::TlsServerCredentials(options);
}

std::optional<TlsFacts> ServerTls::facts() const {
  const std::lock_guard lock(mutex_);
  return facts_;
}

void ServerTls::ReloadIfChanged() {
  if (files_.certificate.empty()) return;
  Contents contents = ReadFiles(files_);
  if (contents == seen_ && !starved_) return;
  const absl::StatusOr<TlsFacts> facts = Take(contents);
  const bool told = contents == seen_;  // only a retry
  OPENSSL_cleanse(seen_[1].data(), seen_[1].size());
  seen_ = std::move(contents);
  starved_ = absl::IsResourceExhausted(facts.status());
  if (!facts.ok()) {
    if (starved_ && told) return;
    metrics_.reload_failures.Increment();
    LogMessage(LogLevel::kError,
               absl::StrCat("the certificates stay as they were: ", std::string(facts.status().message())));
    return;
  }
  metrics_.reloads.Increment();
  LogMessage(LogLevel::kInfo, "certificates read from " + files_.certificate);
}

}  // namespace voxelpipe
