// Times: numbers and std::chrono <-> google.protobuf.Duration.
#pragma once

#include <chrono>
#include <string>

#include <google/protobuf/duration.pb.h>

#include "absl/status/statusor.h"

namespace voxelpipe {

// `ms`: milliseconds, not negative; others become 0.
void WriteMs(double ms, google::protobuf::Duration& out);
void WriteTo(std::chrono::milliseconds time, google::protobuf::Duration& out);
// Milliseconds.
double MsOf(const google::protobuf::Duration& time);

// In: a time-out of a request. Out: the same, at most a year. INVALID_ARGUMENT naming the field if it is negative.
absl::StatusOr<std::chrono::milliseconds> ReadTimeout(const google::protobuf::Duration& time, const std::string& field);

}  // namespace voxelpipe
