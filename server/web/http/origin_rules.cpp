#include "web/http/origin_rules.h"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxShownBytes = 100;

std::string Lower(std::string_view text) {
  return absl::AsciiStrToLower(absl::string_view(text.data(), text.size()));
}

// The host of "HOST[:PORT]", without brackets; none if the text is something else.
std::optional<std::string> HostOf(std::string_view authority) {
  std::string_view host = authority, port;
  if (authority.starts_with('[')) {
    const size_t end = authority.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    host = authority.substr(1, end - 1);
    port = authority.substr(end + 1);
  } else if (const size_t colon = authority.find(':'); colon != std::string_view::npos) {
    host = authority.substr(0, colon);
    port = authority.substr(colon);
  }
  if (!port.empty()) {
    int number = 0;
    const std::string digits(port.substr(1));
    if (port[0] != ':' || digits.empty() || digits.size() > 5 ||
        digits.find_first_not_of("0123456789") != std::string::npos || !absl::SimpleAtoi(digits, &number) ||
        number > 65'535) {
      return std::nullopt;
    }
  }
  constexpr std::string_view kPossible = "abcdefghijklmnopqrstuvwxyz0123456789.-_:";
  std::string lower = Lower(host);
  if (lower.empty() || lower.find_first_not_of(kPossible) != std::string::npos) return std::nullopt;
  return lower;
}

bool IsIpAddress(const std::string& host) {
  std::array<unsigned char, sizeof(in6_addr)> bytes{};
  return inet_pton(AF_INET, host.c_str(), bytes.data()) == 1 || inet_pton(AF_INET6, host.c_str(), bytes.data()) == 1;
}

// What stands after the scheme of an origin.
std::string_view AuthorityOf(std::string_view origin) {
  return origin.substr(origin.find("//") + 2);
}

}  // namespace

absl::StatusOr<std::vector<std::string>> ParseOrigins(std::string_view text) {
  std::vector<std::string> origins;
  for (const absl::string_view part :
       absl::StrSplit(absl::string_view(text.data(), text.size()), ',', absl::SkipWhitespace())) {
    const std::string origin = absl::AsciiStrToLower(absl::StripAsciiWhitespace(part));
    const bool scheme = origin.starts_with("http://") || origin.starts_with("https://");
    if (!scheme || !HostOf(AuthorityOf(origin))) {
      return absl::InvalidArgumentError(absl::StrCat("no origin such as https://voxels.example.org: ", origin));
    }
    origins.push_back(origin);
  }
  return origins;
}

OriginRules::OriginRules(std::string_view address, std::vector<std::string> allowed)
    : listen_host_(HostOf(address).value_or("")), allowed_(std::move(allowed)) {}

bool OriginRules::IsOwnHost(std::string_view authority) const {
  const std::optional<std::string> host = HostOf(authority);
  if (!host) return false;
  if (IsIpAddress(*host) || *host == "localhost" || *host == listen_host_) return true;
  const std::string lower = Lower(authority);
  return std::any_of(allowed_.begin(), allowed_.end(), [&](const auto& o) { return AuthorityOf(o) == lower; });
}

absl::Status OriginRules::Check(const RequestSource& source) const {
  if (!source.host || !IsOwnHost(*source.host)) {
    return absl::PermissionDeniedError(absl::StrCat("this server is not known as '",
                                                    CleanText(source.host.value_or(""), kMaxShownBytes),
                                                    "'; --web-origin names the origin under which browsers see it"));
  }
  const auto refused = [](std::string_view what) {
    return absl::PermissionDeniedError(absl::StrCat("a page of ", CleanText(what, kMaxShownBytes),
                                                    " may not use this server; --web-origin allows it"));
  };
  if (source.origin) {
    if (Lower(*source.origin) == absl::StrCat("http://", Lower(*source.host)) || IsForeignAllowed(source)) {
      return absl::OkStatus();
    }
    return refused(*source.origin);
  }
  // Browsers send no Origin with simple requests of some kinds, but say where they come from.
  if (source.fetch_site && *source.fetch_site != "same-origin" && *source.fetch_site != "none") {
    return refused("another origin");
  }
  return absl::OkStatus();
}

bool OriginRules::IsForeignAllowed(const RequestSource& source) const {
  return source.origin && std::find(allowed_.begin(), allowed_.end(), Lower(*source.origin)) != allowed_.end();
}

}  // namespace voxelpipe
