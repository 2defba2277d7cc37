// Who a client is by the certificate that it showed.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <grpcpp/security/auth_context.h>

namespace voxelpipe {

// The names in a certificate.
struct CertificateNames {
  std::vector<std::string> alternative_names;  // DNS, URI, address and mail names, in its order
  std::string common_name;
};

// In: names of a certificate that was verified. Out: the first alternative name, else the common name, that can name a
// client: 1 to 128 letters, digits and . _ - : / @. Empty where there is none.
std::string ClientNameOf(const CertificateNames& names);
bool IsCertificateName(std::string_view name);

// The same of a connection; empty where its client showed no certificate, or one that was not verified.
std::string ClientNameOf(const grpc::AuthContext& connection);

// Whom fairness holds a caller without a name for: its address, without the port.
std::string HostOfPeer(const std::string& peer);

}  // namespace voxelpipe
