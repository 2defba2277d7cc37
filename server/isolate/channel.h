// Messages between the server and a process that loads meshes: an archive each, over a socket, or through shared memory
// if it is large.
#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "isolate/archive.h"
#include "isolate/shared_region.h"

namespace voxelpipe {

enum class MessageKind : uint32_t {
  kReady,     // worker: sandboxed before any untrusted input was read, and ready for it
  kLoad,      // server: a file -> a LoadedMesh
  kTextures,  // server: textures -> the same, decoded
  kTrim,      // server: release unused memory; no answer
  kAnswer,    // worker: a status, followed by the result if it is OK
};

// A received message. `bulk` is in shared memory, which the other side may change, or in the channel's buffer; valid
// until the next message.
struct Message {
  MessageKind kind = MessageKind::kReady;
  uint64_t number = 0;  // of the request
  std::vector<uint8_t> text;
  std::span<const uint8_t> bulk;
};

// One end of the channel. Not thread-safe.
class Channel {
 public:
  // Takes the descriptor of a socket of type SOCK_SEQPACKET, and the regions that this end writes and reads. `trusts`:
  // false to check the declared size of a message against the resident memory of its region.
  Channel(int socket, SharedRegion out, SharedRegion in, bool trusts);
  Channel(Channel&&) = delete;
  ~Channel();

  int socket() const { return socket_; }
  SharedRegion& out() { return out_; }
  SharedRegion& in() { return in_; }

  // RESOURCE_EXHAUSTED if the archive does not fit into memory; UNAVAILABLE if the other end is closed.
  absl::Status Send(MessageKind kind, uint64_t number, const ArchiveWriter& archive);
  // Waits for a message, at most for `patience`; without limit if that is negative. DEADLINE_EXCEEDED: none came;
  // UNAVAILABLE: the other end is closed; ABORTED: it is closed and has not read what was sent last; INTERNAL: it is
  // not a valid message; RESOURCE_EXHAUSTED: it has more than `most_bytes`, or memory is short. May throw bad_alloc.
  absl::StatusOr<Message> Receive(std::chrono::milliseconds patience, uint64_t most_bytes = SharedRegion::kBytes / 2);

  // True if the other end is closed; what it sent before can still be received.
  bool IsClosed() const;
  // True if Receive would not wait for a message.
  bool HasMessage() const;

 private:
  const int socket_;
  SharedRegion out_, in_;
  const bool trusts_;
  std::vector<uint64_t> buffer_;  // uint64_t for its alignment
};

}  // namespace voxelpipe
