// SHA-256 (FIPS 180-4). A library of its own, voxelpipe_sha256: it needs OpenSSL, which the core does without.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace voxelpipe {

// Of bytes that come in pieces. May throw bad_alloc.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  void Update(std::span<const uint8_t> bytes);
  // 64 lower-case hexadecimal digits. Call once, last.
  std::string HexDigest();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// The same of bytes that are there.
std::string Sha256Hex(std::span<const uint8_t> bytes);

}  // namespace voxelpipe
