// Text that may go into messages and trailers, to a terminal, and into a log.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>

#include "absl/status/status.h"

namespace voxelpipe {

// `text` as protobuf strings, terminals and logs need it: every byte that is not part of valid UTF-8, and every control
// character, becomes '?'. Control characters are C0, DEL and C1, which steer terminals, the separators of lines and
// paragraphs, and those of bidirectional text, which reorder what is around them. Text longer than `max_bytes` is cut
// before a character and ends in "...". Names in untrusted files appear in messages.
std::string CleanText(std::string_view text, size_t max_bytes = std::string_view::npos);

// In: a JSON text in valid UTF-8, whose C0 control characters are escaped. Out: with the other control characters of
// CleanText as \uXXXX too: the same value, and CleanText would change nothing between its line breaks.
std::string EscapeControls(std::string_view json);

// Writes CleanText(line) and a newline, and flushes. Whatever a program prints beside the data that it makes goes
// through here, as names and texts in it may come from a file or from a server. False, with errno, if it fails.
bool WriteLine(std::FILE* to, std::string_view line);

inline constexpr size_t kMaxErrorBytes = 1000;
// The sanitized message of an error, at most kMaxErrorBytes: what users see, in-process and from a server.
std::string ErrorText(const absl::Status& status);

// "1000 bytes"; from 1 MiB on also in a larger unit: "5.3 GiB (5694653072 bytes)".
std::string BytesText(uint64_t bytes);

}  // namespace voxelpipe
