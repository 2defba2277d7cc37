#include "observe/trace.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <random>

#include "absl/strings/str_format.h"

namespace voxelpipe {
namespace {

constexpr size_t kVersionEnd = 2, kTraceEnd = 35, kSpanEnd = 52, kFlagsEnd = 55;

bool IsLowerHex(std::string_view text) {
  return text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

bool IsZero(std::string_view text) {
  return text.find_first_not_of('0') == std::string_view::npos;
}

int HexDigit(char c) {
  return c <= '9' ? c - '0' : c - 'a' + 10;
}

}  // namespace

std::optional<TraceContext> ParseTraceparent(std::string_view value) {
  if (value.size() < kFlagsEnd) return std::nullopt;
  const std::string_view version = value.substr(0, kVersionEnd), trace = value.substr(3, 32),
                         span = value.substr(36, 16), flags = value.substr(53, 2);
  if (value[kVersionEnd] != '-' || value[kTraceEnd] != '-' || value[kSpanEnd] != '-') return std::nullopt;
  if (!IsLowerHex(version) || !IsLowerHex(trace) || !IsLowerHex(span) || !IsLowerHex(flags)) return std::nullopt;
  if (version == "ff" || IsZero(trace) || IsZero(span)) return std::nullopt;
  if (value.size() > kFlagsEnd && (version == "00" || value[kFlagsEnd] != '-')) return std::nullopt;
  return TraceContext{std::string(trace), std::string(span), (HexDigit(flags[1]) & 1) != 0};
}

bool IsRequestId(std::string_view text) {
  constexpr size_t kLongest = 64;
  return !text.empty() && text.size() <= kLongest && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' ||
           c == '-';
  });
}

std::string MakeRequestId() {
  static const uint32_t process = std::random_device()();
  static std::atomic<uint64_t> next{1};
  return absl::StrFormat("%08x-%u", process, next.fetch_add(1, std::memory_order_relaxed));
}

}  // namespace voxelpipe
