// The health client inside the server's own binary, for container health checks.
#pragma once

#include <string>

namespace voxelpipe {

// 0 if the server at `address` answers SERVING within three seconds, else 1 with one line on stderr.
int Probe(const std::string& address);

}  // namespace voxelpipe
