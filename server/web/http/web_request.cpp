#include "web/http/web_request.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "export/file_export.h"

namespace voxelpipe {
namespace {

// What the service reads of a caller's metadata. Other headers are for browsers and proxies.
constexpr const char* kForwarded[] = {"authorization", "traceparent", "x-request-id"};

bool IsPrintable(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

}  // namespace

std::optional<std::string_view> HeaderOf(MHD_Connection* connection, const char* name) {
  const char* const value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  if (value == nullptr) return std::nullopt;
  return std::string_view(value);
}

RequestSource SourceOf(MHD_Connection* connection) {
  return {HeaderOf(connection, "Host"), HeaderOf(connection, "Origin"), HeaderOf(connection, "Sec-Fetch-Site")};
}

bool HasBody(MHD_Connection* connection) {
  return HeaderOf(connection, "Transfer-Encoding") || HeaderOf(connection, "Content-Length").value_or("0") != "0";
}

int SocketOf(MHD_Connection* connection) {
  const MHD_ConnectionInfo* const info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
  return info != nullptr ? info->connect_fd : -1;
}

const sockaddr* AddressOf(MHD_Connection* connection) {
  const MHD_ConnectionInfo* const info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
  return info != nullptr ? info->client_addr : nullptr;
}

std::string PeerOf(MHD_Connection* connection) {
  const sockaddr* const address = AddressOf(connection);
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address == nullptr) return "unknown";
  if (address->sa_family == AF_INET6) {
    const auto& at = *reinterpret_cast<const sockaddr_in6*>(address);
    inet_ntop(AF_INET6, &at.sin6_addr, text.data(), text.size());
    return absl::StrCat("ipv6:%5B", text.data(), "%5D:", ntohs(at.sin6_port));
  }
  const auto& at = *reinterpret_cast<const sockaddr_in*>(address);
  inet_ntop(AF_INET, &at.sin_addr, text.data(), text.size());
  return absl::StrCat("ipv4:", text.data(), ":", ntohs(at.sin_port));
}

CallHead CallerOf(MHD_Connection* connection) {
  // No certificate: the port has no TLS.
  return {HeaderOf(connection, "authorization"), HeaderOf(connection, "x-request-id"),
          HeaderOf(connection, "traceparent"), PeerOf(connection), ""};
}

absl::StatusOr<BridgeCall::Setup> CallOf(const WebContext& web, MHD_Connection* connection, std::string method) {
  BridgeCall::Setup setup;
  setup.method = std::move(method);
  setup.client = SocketOf(connection);
  for (const char* const name : kForwarded) {
    const std::optional<std::string_view> value = HeaderOf(connection, name);
    if (!value) continue;
    if (!IsPrintable(*value)) {
      return absl::InvalidArgumentError(absl::StrCat(name, ": has bytes other than printable ASCII"));
    }
    setup.metadata.emplace_back(name, *value);
  }
  setup.metadata.emplace_back(ForwardedPeers::kKey, web.state.peers.Write(PeerOf(connection)));
  if (const auto text = HeaderOf(connection, "grpc-timeout")) {
    absl::StatusOr<std::chrono::nanoseconds> timeout = ParseTimeout(*text);
    if (!timeout.ok()) return timeout.status();
    setup.timeout = *timeout;
  }
  return setup;
}

absl::StatusOr<const OutputFormat*> AskedFormat(MHD_Connection* connection) {
  const char* const asked = MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, "format");
  return ExportFormatNamed(asked == nullptr ? "" : asked);
}

bool IsType(std::optional<std::string_view> type, std::string_view wanted) {
  if (!type) return false;
  const std::string_view name = type->substr(0, std::min(type->find(';'), type->size()));
  return absl::EqualsIgnoreCase(absl::StripAsciiWhitespace(absl::string_view(name.data(), name.size())),
                                absl::string_view(wanted.data(), wanted.size()));
}

}  // namespace voxelpipe
