// SHA-256 (FIPS 180-4). A library of its own, voxelpipe_sha256, because it needs OpenSSL, which the core does not use.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace voxelpipe {

// An incremental hash. May throw bad_alloc.
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

// The hash of one span of bytes.
std::string Sha256Hex(std::span<const uint8_t> bytes);

}  // namespace voxelpipe
