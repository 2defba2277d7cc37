#include "web/http/frames.h"

#include <algorithm>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace voxelpipe {
namespace {

constexpr uint8_t kCompressed = 0x01, kTrailers = 0x80;

FrameHead MakeHead(uint8_t flags, uint64_t bytes) {
  return {flags, uint8_t(bytes >> 24), uint8_t(bytes >> 16), uint8_t(bytes >> 8), uint8_t(bytes)};
}

}  // namespace

absl::Status CheckRequestFrame(std::string_view head, uint64_t body_bytes) {
  if (head.size() < kFrameHeadBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("body: ", body_bytes, " bytes, a gRPC-Web frame has at least ", kFrameHeadBytes));
  }
  const auto byte = [head](size_t i) { return uint64_t{uint8_t(head[i])}; };
  if ((byte(0) & kCompressed) != 0) {
    return absl::UnimplementedError("body: a compressed message; send it with grpc-encoding identity");
  }
  if (byte(0) != 0) return absl::InvalidArgumentError(absl::StrCat("body: the first frame has the flags ", byte(0)));
  const uint64_t announced = byte(1) << 24 | byte(2) << 16 | byte(3) << 8 | byte(4);
  const uint64_t have = body_bytes - kFrameHeadBytes;
  if (announced == have) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("body: its frame announces a message of ", announced, " bytes, ", have,
                                                 " follow; a request is one message"));
}

FrameHead HeadOfMessage(uint64_t bytes) {
  return MakeHead(0, bytes);
}

std::string TrailerFrame(const grpc::Status& status, const WebMetadata& trailers) {
  std::string lines = absl::StrCat("grpc-status: ", int(status.error_code()), "\r\n");
  if (!status.error_message().empty()) {
    absl::StrAppend(&lines, "grpc-message: ", PercentEncoded(status.error_message()), "\r\n");
  }
  if (!status.error_details().empty()) {
    absl::StrAppend(&lines, "grpc-status-details-bin: ", BinaryValue(status.error_details()), "\r\n");
  }
  for (const auto& [key, value] : trailers) absl::StrAppend(&lines, key, ": ", PercentEncoded(value), "\r\n");
  const FrameHead head = MakeHead(kTrailers, lines.size());
  return std::string(head.begin(), head.end()) + lines;
}

std::string BinaryValue(std::string_view bytes) {
  std::string value = absl::Base64Escape(absl::string_view(bytes.data(), bytes.size()));
  value.erase(std::min(value.find('='), value.size()));
  return value;
}

std::string PercentEncoded(std::string_view text) {
  std::string encoded;
  for (const char c : text) {
    if (c >= ' ' && c <= '~' && c != '%') {
      encoded += c;
    } else {
      absl::StrAppendFormat(&encoded, "%%%02X", uint8_t(c));
    }
  }
  return encoded;
}

absl::StatusOr<std::chrono::nanoseconds> ParseTimeout(std::string_view text) {
  constexpr size_t kMaxDigits = 8;
  constexpr std::pair<char, int64_t> kUnits[] = {{'H', 3'600'000'000'000}, {'M', 60'000'000'000}, {'S', 1'000'000'000},
                                                 {'m', 1'000'000},         {'u', 1'000},          {'n', 1}};
  const std::string digits(text.substr(0, text.empty() ? 0 : text.size() - 1));
  const auto* const unit = std::find_if(std::begin(kUnits), std::end(kUnits),
                                        [&](const auto& u) { return !text.empty() && u.first == text.back(); });
  int64_t count = 0;
  if (digits.empty() || digits.size() > kMaxDigits || unit == std::end(kUnits) ||
      digits.find_first_not_of("0123456789") != std::string::npos || !absl::SimpleAtoi(digits, &count)) {
    return absl::InvalidArgumentError("grpc-timeout: not 1 to 8 digits and one of H, M, S, m, u, n");
  }
  // 10^8 hours are more nanoseconds than fit; a century counts as no limit.
  constexpr int64_t kCentury = int64_t{36'500} * 24 * 3'600'000'000'000;
  return std::chrono::nanoseconds(count > kCentury / unit->second ? kCentury : count * unit->second);
}

}  // namespace voxelpipe
