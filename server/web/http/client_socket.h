// The connection of an HTTP client, looked at while its request waits for something else, and its end.
#pragma once

#include <chrono>
#include <cstdint>

namespace voxelpipe {

// True if the client has closed its connection, or its half of it.
bool HasHungUp(int socket);

// Ends the server's half of the connection, and drops what the client still sends until it hangs up, for at most `time`
// and at most `bytes`. A socket that is closed before its last byte was received resets the connection, and on some
// systems the client loses the answer with it.
void DropRest(int socket, std::chrono::milliseconds time, uint64_t bytes);

}  // namespace voxelpipe
