// The bytes of a glTF document: GLB chunk, data: URIs, meshopt-compressed buffer views.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/gltf/document/gltf_document.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe::gltf {

// What the scene takes from the job's memory: one declared count can stand for gigabytes. As everything that takes long
// takes from it first, it is also where the job is polled. Not thread-safe, but for job().
class Budget {
 public:
  // `job` and `limits` must outlive this. `file_bytes`: of all that was given to load.
  Budget(const JobContext& job, const LoadLimits& limits, uint64_t file_bytes)
      : job_(job), limits_(limits), file_bytes_(file_bytes), charge_(&MemoryOf(job)) {}
  // Takes elements * bytes_each, before they are allocated. RESOURCE_EXHAUSTED naming `what`; the job's error once it
  // is over.
  absl::Status Take(uint64_t elements, uint64_t bytes_each, const std::string& what) {
    return Take(elements, bytes_each, what, charge_);
  }
  // The same for what does not live as long as the scene: `charge` gives it back (NewCharge).
  absl::Status Take(uint64_t elements, uint64_t bytes_each, const std::string& what, MemoryCharge& charge) const;
  MemoryCharge NewCharge() const { return MemoryCharge(&MemoryOf(job_)); }

  // True if so many elements without bytes of their own are no more than a file of this size may declare:
  // RESOURCE_EXHAUSTED.
  absl::Status CheckDeclared(uint64_t elements, uint64_t bytes_each, const std::string& what) const;

  // What the scene has taken so far, and a way to give back what of it is gone again.
  uint64_t bytes() const { return charge_.bytes(); }
  void ShrinkTo(uint64_t bytes) { charge_.ShrinkTo(bytes); }
  // Hands over what was taken; this has taken nothing then.
  MemoryCharge Release() { return std::exchange(charge_, NewCharge()); }

  const LoadLimits& limits() const { return limits_; }
  const JobContext& job() const { return job_; }

 private:
  const JobContext& job_;
  const LoadLimits& limits_;
  const uint64_t file_bytes_;
  MemoryCharge charge_;
};

// True if an error is the file's own, so that it may stay with the part that it is of: not the end of the job, nor
// memory that others use now.
bool IsOfFile(const absl::Status& error);

// True if a URI holds its data, whatever the case of its scheme.
bool IsDataUri(std::string_view uri);

// In: a data: URI. Out: its media type and bytes. Errors: INVALID_ARGUMENT saying what is not valid (base64, percent
// escapes, a missing comma, an encoding that is not known), without naming the owner of the URI; the job's.
struct DataUri {
  std::string media_type;
  std::vector<uint8_t> bytes;
};
absl::StatusOr<DataUri> DecodeDataUri(const JobContext& job, std::string_view uri);

// Resolved once per document. Views that it hands out live as long as it does (and the GLB chunk).
class Buffers {
 public:
  // In: the document (moved-from URIs are freed), and GLB's BIN chunk if there is one.
  // Errors: INVALID_ARGUMENT naming the buffer and its URI: only data: URIs and the chunk are read, never a file.
  static absl::StatusOr<Buffers> Resolve(Document& document, std::optional<std::span<const uint8_t>> chunk,
                                         Budget& budget);

  // The bytes of a buffer view; a meshopt-compressed one is decoded at first use.
  // Errors: INVALID_ARGUMENT naming the view; of one that is decoded, RESOURCE_EXHAUSTED and the job's, too.
  absl::StatusOr<std::span<const uint8_t>> View(uint32_t index, Budget& budget);

  // Bytes from one element to the next in a view's data, 0 if it is tightly packed.
  uint64_t Stride(uint32_t index) const;

 private:
  absl::StatusOr<std::vector<uint8_t>> Decode(const MeshoptDecl& decl, Budget& budget);

  const Document* document_ = nullptr;
  MemoryCharge charge_;                              // of the two below
  std::vector<std::vector<uint8_t>> owned_;          // data: URIs, by buffer
  std::vector<std::span<const uint8_t>> bytes_;      // by buffer; empty for a placeholder
  std::vector<std::vector<uint8_t>> decoded_views_;  // by view
};

}  // namespace voxelpipe::gltf
