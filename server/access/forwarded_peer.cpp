#include "access/forwarded_peer.h"

#include <cstdint>
#include <random>

#include <openssl/crypto.h>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace voxelpipe {

ForwardedPeers::ForwardedPeers() {
  constexpr int kWords = 4;   // 128 bits
  std::random_device random;  // the system's generator
  for (int i = 0; i < kWords; ++i) absl::StrAppendFormat(&secret_, "%08x", uint32_t(random()));
}

std::string ForwardedPeers::Write(std::string_view peer) const {
  return absl::StrCat(secret_, " ", std::string(peer));
}

std::optional<std::string> ForwardedPeers::Read(std::string_view value) const {
  const size_t bytes = secret_.size();
  if (value.size() <= bytes || CRYPTO_memcmp(value.data(), secret_.data(), bytes) != 0 || value[bytes] != ' ') {
    return std::nullopt;
  }
  return std::string(value.substr(bytes + 1));
}

}  // namespace voxelpipe
