#include "engine/hash.h"

#include <openssl/evp.h>

#include <array>

namespace voxelpipe::cli {
namespace {

std::string Hex(std::span<const unsigned char> digest) {
  std::string hex;
  for (const unsigned char byte : digest) {
    hex += "0123456789abcdef"[byte >> 4];
    hex += "0123456789abcdef"[byte & 15];
  }
  return hex;
}

absl::Status Failed() {
  return absl::InternalError("OpenSSL cannot compute a SHA-256");
}

}  // namespace

absl::StatusOr<std::string> Sha256Hex(std::span<const uint8_t> bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &size, EVP_sha256(), nullptr) != 1) return Failed();
  return Hex({digest.data(), size});
}

struct HashingSink::Context {
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> digest{EVP_MD_CTX_new(), &EVP_MD_CTX_free};
  bool ok = digest != nullptr && EVP_DigestInit_ex(digest.get(), EVP_sha256(), nullptr) == 1;
};

HashingSink::HashingSink(ResultSink* next) : context_(std::make_unique<Context>()), next_(next) {}

HashingSink::~HashingSink() = default;

absl::Status HashingSink::Begin(const ResultHeader& header) {
  header_ = header;
  return next_ != nullptr ? next_->Begin(header) : absl::OkStatus();
}

absl::Status HashingSink::Write(size_t array, std::span<const uint8_t> bytes) {
  bytes_ += bytes.size();
  context_->ok = context_->ok && EVP_DigestUpdate(context_->digest.get(), bytes.data(), bytes.size()) == 1;
  return next_ != nullptr ? next_->Write(array, bytes) : absl::OkStatus();
}

absl::StatusOr<std::string> HashingSink::Digest() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  const bool ok = context_->ok && EVP_DigestFinal_ex(context_->digest.get(), digest.data(), &size) == 1;
  if (!ok) return Failed();
  return Hex({digest.data(), size});
}

}  // namespace voxelpipe::cli
