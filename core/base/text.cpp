#include "base/text.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>

namespace voxelpipe {
namespace {

// Length of the valid UTF-8 character at the start of `text`, 0 if there is none.
size_t CharacterLength(std::string_view text) {
  const auto byte = [&](size_t i) { return uint8_t(text[i]); };
  const uint8_t lead = byte(0);
  if (lead < 0x80) return 1;
  const size_t length = lead >= 0xc2 && lead < 0xe0   ? 2
                        : lead >= 0xe0 && lead < 0xf0 ? 3
                        : lead >= 0xf0 && lead < 0xf5 ? 4
                                                      : 0;
  if (length == 0 || text.size() < length) return 0;
  for (size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
  }
  if (lead == 0xe0 && byte(1) < 0xa0) return 0;  // overlong
  if (lead == 0xed && byte(1) > 0x9f) return 0;  // surrogates
  if (lead == 0xf0 && byte(1) < 0x90) return 0;  // overlong
  if (lead == 0xf4 && byte(1) > 0x8f) return 0;  // beyond U+10FFFF
  return length;
}

// The code point of a valid character.
uint32_t CodePoint(std::string_view character) {
  if (character.size() == 1) return uint8_t(character[0]);
  uint32_t code = uint8_t(character[0]) & (0xff >> (character.size() + 1));
  for (const char c : character.substr(1)) code = code << 6 | (uint8_t(c) & 0x3f);
  return code;
}

bool IsControl(uint32_t code) {
  return code < 0x20 || (code >= 0x7f && code < 0xa0) ||       // C0, DEL, C1
         code == 0x61c || code == 0x200e || code == 0x200f ||  // marks of a direction
         (code >= 0x2028 && code <= 0x202e) ||                 // separators, embeddings, overrides
         (code >= 0x2066 && code <= 0x2069);                   // isolates
}

}  // namespace

std::string CleanText(std::string_view text, size_t max_bytes) {
  const auto printable = [](char c) { return c >= ' ' && c <= '~'; };
  if (text.size() <= max_bytes && std::all_of(text.begin(), text.end(), printable)) return std::string(text);
  constexpr std::string_view kCut = "...";
  std::string clean;
  clean.reserve(text.size() < max_bytes ? text.size() : max_bytes);
  size_t cut_at = 0;  // the start of the last character before which kCut fits
  for (size_t i = 0; i < text.size();) {
    if (clean.size() + kCut.size() <= max_bytes) cut_at = clean.size();
    const size_t length = CharacterLength(text.substr(i));
    if (length == 0 || IsControl(CodePoint(text.substr(i, length)))) {
      clean.push_back('?');
    } else {
      clean.append(text.substr(i, length));
    }
    i += length == 0 ? 1 : length;
    if (clean.size() > max_bytes) {
      clean.resize(cut_at);
      return clean.append(kCut.substr(0, max_bytes - cut_at));
    }
  }
  return clean;
}

std::string EscapeControls(std::string_view json) {
  std::string escaped;
  escaped.reserve(json.size());
  for (size_t i = 0; i < json.size();) {
    const std::string_view character = json.substr(i, std::max<size_t>(1, CharacterLength(json.substr(i))));
    i += character.size();
    const uint32_t code = CodePoint(character);
    if (code < 0x20 || (character.size() == 1 && code > 0x7f) || !IsControl(code)) {  // or a line break between values
      escaped.append(character);
      continue;
    }
    char text[12];
    std::snprintf(text, sizeof text, "\\u%04x", unsigned(code));
    escaped.append(text);
  }
  return escaped;
}

bool WriteLine(std::FILE* to, std::string_view line) {
  const std::string clean = CleanText(line) + "\n";
  return std::fwrite(clean.data(), 1, clean.size(), to) == clean.size() && std::fflush(to) == 0;
}

std::string ErrorText(const absl::Status& status) {
  return CleanText({status.message().data(), status.message().size()}, kMaxErrorBytes);
}

std::string BytesText(uint64_t bytes) {
  const std::string exact = std::to_string(bytes) + " bytes";
  constexpr uint64_t kMiB = uint64_t{1} << 20;
  if (bytes < kMiB) return exact;
  double value = double(bytes) / double(kMiB);
  const char* unit = "MiB";
  for (const char* larger : {"GiB", "TiB", "PiB", "EiB"}) {
    if (value < 1024) break;
    value /= 1024;
    unit = larger;
  }
  char text[32];
  const bool whole = value == double(uint64_t(value));
  std::snprintf(text, sizeof text, whole ? "%.0f %s" : "%.1f %s", value, unit);
  return text + (" (" + exact + ")");
}

}  // namespace voxelpipe
