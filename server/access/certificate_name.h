// The identity of a client, from its certificate.
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

// In: names of a verified certificate. Out: the first alternative name, otherwise the common name, that can name a
// client: 1 to 128 letters, digits and . _ - : / @. Empty if there is none.
std::string ClientNameOf(const CertificateNames& names);
bool IsCertificateName(std::string_view name);

// The same for a connection; empty if its client has no certificate, or an unverified one.
std::string ClientNameOf(const grpc::AuthContext& connection);

// The client name of an anonymous caller for fairness: its address, without the port.
std::string HostOfPeer(const std::string& peer);

}  // namespace voxelpipe
