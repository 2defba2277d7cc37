#include "access/certificate_name.h"

#include <algorithm>

#include <grpc/grpc_security_constants.h>

namespace voxelpipe {
namespace {

constexpr size_t kMaxNameBytes = 128;

bool MayStand(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
         std::string_view("._-:/@").find(c) != std::string_view::npos;
}

}  // namespace

bool IsCertificateName(std::string_view name) {
  return !name.empty() && name.size() <= kMaxNameBytes && std::all_of(name.begin(), name.end(), MayStand);
}

std::string ClientNameOf(const CertificateNames& names) {
  for (const std::string& name : names.alternative_names) {
    if (IsCertificateName(name)) return name;
  }
  return IsCertificateName(names.common_name) ? names.common_name : "";
}

std::string ClientNameOf(const grpc::AuthContext& connection) {
  // These properties exist only if certificates are verified; then gRPC refuses clients whose certificate fails.
  CertificateNames names;
  for (const grpc::string_ref& name : connection.FindPropertyValues(GRPC_X509_SAN_PROPERTY_NAME)) {
    names.alternative_names.emplace_back(name.data(), name.size());
  }
  for (const grpc::string_ref& name : connection.FindPropertyValues(GRPC_X509_CN_PROPERTY_NAME)) {
    names.common_name.assign(name.data(), name.size());
  }
  return ClientNameOf(names);
}

std::string HostOfPeer(const std::string& peer) {
  if (!peer.starts_with("ipv4:") && !peer.starts_with("ipv6:")) return peer;
  return peer.substr(0, peer.rfind(':'));
}

}  // namespace voxelpipe
