// data: URIs, the only ones that a loader reads.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

// True if a URI is a data: URI; the case of the scheme does not matter.
bool IsDataUri(std::string_view uri);

// In: a data: URI. Out: its media type, name and bytes. Errors: INVALID_ARGUMENT saying what is not valid (base64,
// percent escapes, a missing comma or one beyond 64 KiB, an unknown encoding), without naming the owner of the URI; the
// job's.
struct DataUri {
  std::string media_type;
  std::string name;  // its parameter "name", empty without one
  std::vector<uint8_t> bytes;
};
absl::StatusOr<DataUri> DecodeDataUri(const JobContext& job, std::string_view uri);

}  // namespace voxelpipe
