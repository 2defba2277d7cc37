#include "service/support/certificates.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "absl/strings/str_cat.h"

namespace voxelpipe::testing {
namespace {

constexpr char kNewKey[] = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes";

absl::Status Run(const std::string& folder, const std::string& command) {
  const std::string line = absl::StrCat("cd '", folder, "' && { ", command, "; } >>openssl.log 2>&1");
  // The command contains no untrusted input.
  if (std::system(line.c_str()) != 0) return absl::InternalError(absl::StrCat("openssl: see ", folder, "/openssl.log"));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<CertificateAuthority> CertificateAuthority::Make() {
  std::string folder = (std::filesystem::temp_directory_path() / "voxelpipe-ca-XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) return absl::InternalError("no folder for certificates");
  CertificateAuthority authority(folder);
  std::ofstream(folder + "/ca.cnf") << "[ca]\ndefault_ca=d\n[d]\ndatabase=index.txt\nnew_certs_dir=.\nserial=serial\n"
                                       "default_md=sha256\npolicy=p\nrand_serial=yes\n[p]\ncommonName=supplied\n";
  std::ofstream(folder + "/index.txt").flush();
  const absl::Status status =
      Run(folder, absl::StrCat("openssl req -x509 ", kNewKey, " -keyout ca.key -out ca.pem -subj /CN=test-ca -days 3"));
  if (!status.ok()) return status;
  return authority;
}

CertificateAuthority::~CertificateAuthority() {
  std::error_code ignored;
  if (!folder_.empty()) std::filesystem::remove_all(folder_, ignored);
}

absl::StatusOr<CertificateFiles> CertificateAuthority::Sign(const std::string& name, int days) const {
  std::ofstream(folder_ + "/" + name + ".ext") << "subjectAltName=DNS:" << name << ".test,IP:127.0.0.1\n";
  const std::string time = days > 0 ? absl::StrCat("-days ", days)
                                    : "-startdate $(date -u -d '3 days ago' +%y%m%d%H%M%SZ) "
                                      "-enddate $(date -u -d '1 day ago' +%y%m%d%H%M%SZ)";
  const absl::Status status =
      Run(folder_, absl::StrCat("openssl req ", kNewKey, " -keyout ", name, ".key -out ", name, ".csr -subj /CN=", name,
                                " && openssl ca -batch -notext -config ca.cnf -cert ca.pem -keyfile ca.key -in ", name,
                                ".csr -out ", name, ".pem -extfile ", name, ".ext ", time));
  if (!status.ok()) return status;
  return CertificateFiles{folder_ + "/" + name + ".pem", folder_ + "/" + name + ".key"};
}

}  // namespace voxelpipe::testing
