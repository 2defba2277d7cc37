#include "probe.h"

#include <chrono>
#include <cstdio>
#include <string>

#include <grpcpp/grpcpp.h>
#include <grpcpp/security/tls_certificate_verifier.h>
#include <grpcpp/security/tls_credentials_options.h>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "observe/http_status.h"

namespace voxelpipe {

namespace {

constexpr int kPatienceMs = 3000;

int ProbeHttp(const std::string& address) {
  std::string error;
  const int status = HttpStatusOf(address, "/readyz", kPatienceMs, error);
  if (status == 200) return 0;
  if (status != 0) error = "not serving";
  WriteLine(stderr, absl::StrCat("voxelpiped: http://", address, "/readyz: ", error));
  return 1;
}

// Accepts every certificate.
class Believer final : public grpc::experimental::ExternalCertificateVerifier {
 public:
  bool Verify(grpc::experimental::TlsCustomVerificationCheckRequest*, std::function<void(grpc::Status)>,
              grpc::Status*) override {
    return true;  // done at once, and OK
  }
  void Cancel(grpc::experimental::TlsCustomVerificationCheckRequest*) override {}
};

std::shared_ptr<grpc::ChannelCredentials> CredentialsFor(const TlsFiles& files) {
  if (files.certificate.empty()) return grpc::InsecureChannelCredentials();
  namespace tls = grpc::experimental;
  constexpr unsigned kNeverAgainSeconds = 3600;
  tls::TlsChannelCredentialsOptions options;
  options.set_certificate_provider(
      std::make_shared<tls::FileWatcherCertificateProvider>(files.key, files.certificate, kNeverAgainSeconds));
  options.watch_identity_key_cert_pairs();
  options.set_verify_server_certs(false);
  options.set_check_call_host(false);
  options.set_certificate_verifier(tls::ExternalCertificateVerifier::Create<Believer>());
  return tls::TlsCredentials(options);
}

}  // namespace

int Probe(const std::string& address, const TlsFiles& tls) {
  constexpr std::string_view kHttp = "http://";
  if (address.starts_with(kHttp)) return ProbeHttp(address.substr(kHttp.size()));
  using grpc::health::v1::HealthCheckResponse;
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);  // a proxy from the environment does not apply to this server
  const auto stub =
      grpc::health::v1::Health::NewStub(grpc::CreateCustomChannel(address, CredentialsFor(tls), arguments));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(kPatienceMs));
  HealthCheckResponse response;
  const grpc::Status status = stub->Check(&context, {}, &response);
  if (!status.ok()) {
    WriteLine(stderr, absl::StrCat("voxelpiped: ", address, ": ", status.error_message()));
    return 1;
  }
  if (response.status() != HealthCheckResponse::SERVING) {
    WriteLine(stderr, absl::StrCat("voxelpiped: ", address, ": not serving"));
    return 1;
  }
  return 0;
}

}  // namespace voxelpipe
