// Which pages may use the server's page port: protection against foreign pages and rebound names. Pure functions.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe {

// In: "https://host[:port]", several separated by commas, or an empty text. Out: each in lower case. INVALID_ARGUMENT
// naming the one that is no origin.
absl::StatusOr<std::vector<std::string>> ParseOrigins(std::string_view text);

// What a request says about where it comes from. Views into the request's headers.
struct RequestSource {
  std::optional<std::string_view> host, origin;  // the headers of these names
  std::optional<std::string_view> fetch_site;    // sec-fetch-site
};

// A name can be bound to this machine's address by its owner, so that a page of that name counts as this server's own
// in the visitor's browser. Therefore a request's Host must be an IP address, localhost, the name that the server
// listens on, or that of an allowed origin.
class OriginRules {
 public:
  // In: HOST:PORT of the port, and the allowed origins (ParseOrigins).
  OriginRules(std::string_view address, std::vector<std::string> allowed);

  // Errors: PERMISSION_DENIED naming what is refused and the option that allows it.
  absl::Status Check(const RequestSource& source) const;
  // True if the source's origin is another one than that of the port and is allowed.
  bool IsForeignAllowed(const RequestSource& source) const;

 private:
  bool IsOwnHost(std::string_view host) const;

  std::string listen_host_;
  std::vector<std::string> allowed_;
};

}  // namespace voxelpipe
