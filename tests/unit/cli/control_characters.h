// Control characters in what a program prints.
#pragma once

#include <cstdio>
#include <string>

namespace voxelpipe::testing {

// What a file or a server might send to steer a terminal: C1, separators of lines, controls of bidirectional text.
inline const std::string kHostileLetters = "\u0085\u009b31m\u009d\u202a\u202e\u2066\u2069\u200e\u200f\u061c\u2028end";
// Before them C0 and DEL.
inline const std::string kHostileText = "\x1b]0;title\x07\x1b[31m\r\n\t\b\x7f" + kHostileLetters;

// The control characters in `text` but line feeds, as "U+001B U+202E"; bytes that are not UTF-8 as "9B". Empty: none.
inline std::string ControlsIn(const std::string& text) {
  std::string found;
  const auto add = [&](const char* form, unsigned code) {
    char name[16];
    std::snprintf(name, sizeof name, form, code);
    found += found.empty() ? name : std::string(" ") + name;
  };
  for (size_t i = 0; i < text.size();) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const size_t length = byte < 0x80 ? 1 : byte >= 0xf0 ? 4 : byte >= 0xe0 ? 3 : byte >= 0xc2 ? 2 : 0;
    if (length == 0 || i + length > text.size()) {
      add("%02X", byte);
      ++i;
      continue;
    }
    unsigned code = length == 1 ? byte : byte & (0xffu >> (length + 1));
    for (size_t k = 1; k < length; ++k) code = code << 6 | (static_cast<unsigned char>(text[i + k]) & 0x3fu);
    i += length;
    const bool control = (code < 0x20 && code != '\n') || (code >= 0x7f && code < 0xa0) || code == 0x61c ||
                         code == 0x200e || code == 0x200f || (code >= 0x2028 && code <= 0x202e) ||
                         (code >= 0x2066 && code <= 0x2069);
    if (control) add("U+%04X", code);
  }
  return found;
}

}  // namespace voxelpipe::testing
