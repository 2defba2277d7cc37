// The health client inside the server's own binary, for container health checks.
#pragma once

#include <string>

#include "access/tls.h"

namespace voxelpipe {

// 0 if the server at `address` answers SERVING within three seconds, else 1 with one line on stderr. "http://HOST:PORT"
// asks /readyz there; any other address the gRPC health service: over TLS if `tls` has a certificate, which is then
// shown as the client's own. Whoever answers is believed: a probe asks its own machine, under a name that the
// certificate need not have.
int Probe(const std::string& address, const TlsFiles& tls);

}  // namespace voxelpipe
