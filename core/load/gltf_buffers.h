// The bytes of a glTF document: GLB chunk, data: URIs, meshopt-compressed buffer views.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/gltf_document.h"
#include "load/limits.h"

namespace voxelpipe::gltf {

// A running sum of decoded bytes against max_decoded_bytes: one declared count can stand for gigabytes. As everything that takes long
// takes of it first, it is also where the job is looked at. Not thread-safe, but for job().
class Budget {
 public:
  // Both must outlive this.
  Budget(const JobContext& job, const LoadLimits& limits) : job_(job), limits_(limits) {}
  // Takes elements * bytes_each, before they are allocated. RESOURCE_EXHAUSTED naming `what`; the job's error once it is over.
  absl::Status Take(uint64_t elements, uint64_t bytes_each, const std::string& what);
  const LoadLimits& limits() const { return limits_; }
  const JobContext& job() const { return job_; }

 private:
  const JobContext& job_;
  const LoadLimits& limits_;
  uint64_t used_ = 0;
};

// Whether a URI holds its data, whatever the case of its scheme.
bool IsDataUri(std::string_view uri);

// In: a data: URI. Out: its media type and bytes. Errors: INVALID_ARGUMENT saying what is not valid (base64, percent
// escapes, a missing comma, an encoding that is not known), without naming the owner of the URI.
struct DataUri {
  std::string media_type;
  std::vector<uint8_t> bytes;
};
absl::StatusOr<DataUri> DecodeDataUri(std::string_view uri);

// Resolved once per document. Views that it hands out live as long as it does (and the GLB chunk).
class Buffers {
 public:
  // In: the document (moved-from URIs are freed), and GLB's BIN chunk if there is one.
  // Errors: INVALID_ARGUMENT naming the buffer and its URI: only data: URIs and the chunk are read, never a file.
  static absl::StatusOr<Buffers> Resolve(Document& document, std::optional<std::span<const uint8_t>> chunk,
                                         Budget& budget);

  // The bytes of a buffer view; a meshopt-compressed one is decoded at first use.
  // Errors: INVALID_ARGUMENT naming the view.
  absl::StatusOr<std::span<const uint8_t>> View(uint32_t index, Budget& budget);

  // Bytes from one element to the next in a view's data, 0 if it is tightly packed.
  uint64_t Stride(uint32_t index) const;

 private:
  absl::StatusOr<std::vector<uint8_t>> Decode(const MeshoptDecl& decl, Budget& budget) const;

  const Document* document_ = nullptr;
  std::vector<std::vector<uint8_t>> owned_;          // data: URIs, by buffer
  std::vector<std::span<const uint8_t>> bytes_;      // by buffer; empty for a placeholder
  std::vector<std::vector<uint8_t>> decoded_views_;  // by view
};

}  // namespace voxelpipe::gltf
