// The connection of an HTTP client, looked at while its request waits for something else.
#pragma once

namespace voxelpipe {

// True if the client has closed its connection, or its half of it.
bool HasHungUp(int socket);

}  // namespace voxelpipe
