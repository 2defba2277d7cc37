// The GLB container: header and chunks.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/warning.h"

namespace voxelpipe {

// Views into the file's bytes.
struct GlbChunks {
  std::string_view json;
  std::optional<std::span<const uint8_t>> binary;
  uint64_t left_over_bytes = 0;  // after the length that the header declares
};

// The warning of such bytes, if there are any.
void AddLeftOverBytes(const GlbChunks& chunks, WarningList& warnings);

// In: a file that begins with the GLB magic. Errors: INVALID_ARGUMENT naming the byte offset: wrong version (glTF 1.0),
// a length field or chunk that overruns the file, a first chunk that is not JSON; the job's.
absl::StatusOr<GlbChunks> SplitGlb(const JobContext& job, std::span<const uint8_t> bytes);

}  // namespace voxelpipe
