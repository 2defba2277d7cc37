// Text that may go into messages and trailers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/status.h"

namespace voxelpipe {

// `text` as protobuf strings need it: every byte that is not part of valid UTF-8, and every control character, becomes
// '?'. Text longer than `max_bytes` is cut before a character and ends in "...". Names in untrusted files appear in
// messages.
std::string CleanText(std::string_view text, size_t max_bytes);

inline constexpr size_t kMaxErrorBytes = 1000;
// The sanitized message of an error, at most kMaxErrorBytes: what users see, in-process and from a server.
std::string ErrorText(const absl::Status& status);

// "1000 bytes"; from 1 MiB on also in a larger unit: "5.3 GiB (5694653072 bytes)".
std::string BytesText(uint64_t bytes);

}  // namespace voxelpipe
