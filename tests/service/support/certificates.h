// Certificates for a test, made by openssl when it runs.
#pragma once

#include <string>
#include <utility>

#include "absl/status/statusor.h"

namespace voxelpipe::testing {

// Files of one certificate and its key, PEM.
struct CertificateFiles {
  std::string certificate, key;
};

// A certificate authority in a folder of its own, which its destructor removes.
class CertificateAuthority {
 public:
  static absl::StatusOr<CertificateAuthority> Make();
  ~CertificateAuthority();
  CertificateAuthority(CertificateAuthority&& other) noexcept : folder_(std::exchange(other.folder_, "")) {}
  CertificateAuthority& operator=(CertificateAuthority&&) = delete;

  // The CA certificate, for clients and servers that trust it.
  std::string ca() const { return folder_ + "/ca.pem"; }
  const std::string& folder() const { return folder_; }
  // One that it signed, for the DNS name NAME.test and 127.0.0.1, valid from now for `days`; with 0 it expired a day
  // ago.
  absl::StatusOr<CertificateFiles> Sign(const std::string& name, int days = 2) const;

 private:
  explicit CertificateAuthority(std::string folder) : folder_(std::move(folder)) {}
  std::string folder_;
};

}  // namespace voxelpipe::testing
