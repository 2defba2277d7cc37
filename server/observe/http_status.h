// A minimal HTTP client for probes.
#pragma once

#include <string>

namespace voxelpipe {

// "HOST" and "PORT" of an address; no host for a port alone. False without a port of digits up to 65535.
bool SplitHostPort(const std::string& address, std::string& host, int& port);

// GET http://ADDRESS/PATH, ADDRESS as a server listens on it: the wildcard means loopback. Out: the status code, or 0
// with one line in `error` if there is no answer within `timeout_ms` milliseconds.
int HttpStatusOf(const std::string& address, const std::string& path, int timeout_ms, std::string& error);

}  // namespace voxelpipe
