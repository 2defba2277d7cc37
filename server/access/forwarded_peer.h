// The address of a caller whose call another part of this process passes on over an in-process channel.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace voxelpipe {

// gRPC has no peer for in-process calls, so the address travels as metadata, behind a secret that only this process
// knows: the same key in a call from elsewhere has no effect. Thread-safe.
class ForwardedPeers {
 public:
  static constexpr char kKey[] = "voxelpiped-forwarded-peer";

  // Draws the secret.
  ForwardedPeers();

  // In: an address as gRPC writes it, "ipv4:127.0.0.1:58468". Out: the value of kKey for the call.
  std::string Write(std::string_view peer) const;
  // The address in a value of kKey; none without the secret.
  std::optional<std::string> Read(std::string_view value) const;

 private:
  std::string secret_;  // hexadecimal
};

}  // namespace voxelpipe
