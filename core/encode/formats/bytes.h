// Headers of binary and text formats.
#pragma once

#include <bit>
#include <charconv>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>

namespace voxelpipe {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie in memory");

inline std::span<const uint8_t> BytesOf(std::string_view text) {
  return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}

// Appends little-endian numbers and texts.
class Bytes {
 public:
  template <typename T>
  requires std::integral<T> || std::floating_point<T> Bytes& Put(T value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Bytes& Text(std::string_view text) {
    bytes_.append(text);
    return *this;
  }
  // `text`, then zeros up to `bytes` in all; a longer text is cut.
  Bytes& Padded(std::string_view text, size_t bytes) {
    bytes_.append(text.substr(0, bytes));
    bytes_.append(bytes - std::min(bytes, text.size()), '\0');
    return *this;
  }

  std::span<const uint8_t> span() const { return BytesOf(bytes_); }
  const std::string& text() const { return bytes_; }
  size_t size() const { return bytes_.size(); }
  void clear() { bytes_.clear(); }
  void Reserve(size_t bytes) { bytes_.reserve(bytes); }

 private:
  std::string bytes_;
};

// The shortest text that reads back as this number: "0.1", "1e-20".
inline std::string Shortest(double number) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, number).ptr};
}

}  // namespace voxelpipe
