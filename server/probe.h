// The health client in the server's own binary, for container health checks.
#pragma once

#include <string>

#include "access/tls.h"

namespace voxelpipe {

// 0 if the server at `address` returns SERVING within three seconds, otherwise 1 with one line on stderr.
// "http://HOST:PORT" requests /readyz there; any other address uses the gRPC health service: over TLS if `tls` has a
// certificate, which is then the client certificate. The server's certificate is not verified: a probe calls its own
// machine, under a name that the certificate need not have.
int Probe(const std::string& address, const TlsFiles& tls);

}  // namespace voxelpipe
