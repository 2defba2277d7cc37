#include "address.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace voxelpipe {
namespace {

// Names of gRPC that have no port, or several.
constexpr absl::string_view kOtherNames[] = {"unix:", "unix-abstract:", "vsock:", "ipv4:", "ipv6:", "xds:"};

bool IsPort(absl::string_view text) {
  int port = 0;
  return text.size() <= 5 && std::all_of(text.begin(), text.end(), absl::ascii_isdigit) &&
         absl::SimpleAtoi(text, &port) && port >= 1 && port <= 65535;
}

// Empty if there is none.
std::string FaultOf(absl::string_view address) {
  for (const absl::string_view name : kOtherNames) {
    if (absl::StartsWith(address, name)) return "";
  }
  if (absl::StartsWith(address, "dns:")) address.remove_prefix(std::max<size_t>(4, address.rfind('/') + 1));
  if (absl::StrContains(address, "://")) return "is a URL";
  const size_t colon = address.rfind(':');
  if (colon == absl::string_view::npos || absl::EndsWith(address, "]")) return "has no port";
  if (colon == 0) return "has no host";
  const absl::string_view host = address.substr(0, colon), port = address.substr(colon + 1);
  if (absl::StrContains(host, ":") && !(absl::StartsWith(host, "[") && absl::EndsWith(host, "]"))) {
    return "has more than one colon; an IPv6 address stands in brackets";
  }
  if (!IsPort(port)) return absl::StrCat("has the port '", port, "', which is none from 1 to 65535");
  return "";
}

}  // namespace

absl::Status CheckAddress(const std::string& address) {
  const std::string fault = FaultOf(address);
  if (fault.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("server: '", address, "' ", fault, "; expected HOST:PORT or unix:/PATH"));
}

}  // namespace voxelpipe
