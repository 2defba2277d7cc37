// The time that a client may be silent.
#pragma once

#include <cstdint>

#include <microhttpd.h>

namespace voxelpipe {

// Whole seconds, rounded up: the library counts no others.
inline unsigned SecondsOf(uint32_t milliseconds) {
  return milliseconds / 1000 + unsigned(milliseconds % 1000 != 0);
}

// While it exists, the client of the connection is not silent but waits for this server. Afterwards it may be silent
// for `seconds`. On the connection's thread.
class ClientTimeoutPause {
 public:
  ClientTimeoutPause(MHD_Connection* connection, unsigned seconds) : connection_(connection), seconds_(seconds) {
    MHD_set_connection_option(connection_, MHD_CONNECTION_OPTION_TIMEOUT, 0u);  // none
  }
  ~ClientTimeoutPause() { MHD_set_connection_option(connection_, MHD_CONNECTION_OPTION_TIMEOUT, seconds_); }
  ClientTimeoutPause(const ClientTimeoutPause&) = delete;
  ClientTimeoutPause& operator=(const ClientTimeoutPause&) = delete;

 private:
  MHD_Connection* const connection_;
  const unsigned seconds_;
};

}  // namespace voxelpipe
