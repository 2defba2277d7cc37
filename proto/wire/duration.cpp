#include "wire/duration.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

// A year, so that no sum of times overflows.
constexpr int64_t kMaxSeconds = int64_t{365} * 24 * 3600;

}  // namespace

void WriteMs(double ms, google::protobuf::Duration& out) {
  constexpr double kMaxMs = double(kMaxSeconds) * 1000;
  const int64_t nanoseconds = std::llround((ms > 0 ? std::min(ms, kMaxMs) : 0) * 1e6);
  out.set_seconds(nanoseconds / 1'000'000'000);
  out.set_nanos(int32_t(nanoseconds % 1'000'000'000));
}

void WriteTo(std::chrono::milliseconds time, google::protobuf::Duration& out) {
  out.set_seconds(time.count() / 1000);
  out.set_nanos(int32_t(time.count() % 1000) * 1'000'000);
}

double MsOf(const google::protobuf::Duration& time) {
  return double(time.seconds()) * 1e3 + double(time.nanos()) * 1e-6;
}

absl::StatusOr<std::chrono::milliseconds> ReadTimeout(const google::protobuf::Duration& time,
                                                      const std::string& field) {
  if (time.seconds() < 0 || time.nanos() < 0) {
    return absl::InvalidArgumentError(absl::StrCat(field, ": must not be negative"));
  }
  return std::chrono::milliseconds(std::min(time.seconds(), kMaxSeconds) * 1000 + time.nanos() / 1'000'000);
}

}  // namespace voxelpipe
