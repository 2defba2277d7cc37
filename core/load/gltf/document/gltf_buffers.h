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

// Charges the scene to the job's memory, because one declared count can stand for gigabytes. Every long step charges
// first, so this also polls the job. Not thread-safe, except job().
class Budget {
 public:
  // `job` and `limits` must outlive this. `file_bytes`: size of the whole input.
  Budget(const JobContext& job, const LoadLimits& limits, uint64_t file_bytes)
      : job_(job), limits_(limits), file_bytes_(file_bytes), charge_(&MemoryOf(job)) {}
  // Charges elements * bytes_each, before they are allocated. RESOURCE_EXHAUSTED naming `what`; the job's error once it
  // is over.
  absl::Status Take(uint64_t elements, uint64_t bytes_each, const std::string& what) {
    return Take(elements, bytes_each, what, charge_);
  }
  // The same for memory that does not live as long as the scene: `charge` releases it (NewCharge).
  absl::Status Take(uint64_t elements, uint64_t bytes_each, const std::string& what, MemoryCharge& charge) const;
  MemoryCharge NewCharge() const { return MemoryCharge(&MemoryOf(job_)); }

  // RESOURCE_EXHAUSTED if a file of this size may not declare so many elements without bytes of their own.
  absl::Status CheckDeclared(uint64_t elements, uint64_t bytes_each, const std::string& what) const;

  // The bytes charged so far, and the release of those already freed.
  uint64_t bytes() const { return charge_.bytes(); }
  void ShrinkTo(uint64_t bytes) { charge_.ShrinkTo(bytes); }
  // Moves the charge out; this has none afterwards.
  MemoryCharge Release() { return std::exchange(charge_, NewCharge()); }

  const LoadLimits& limits() const { return limits_; }
  const JobContext& job() const { return job_; }

 private:
  const JobContext& job_;
  const LoadLimits& limits_;
  const uint64_t file_bytes_;
  MemoryCharge charge_;
};

// True if an error is a fault of the file, which may be stored with the faulty part: not the end of the job, nor memory
// that other jobs use now.
bool IsOfFile(const absl::Status& error);

// Resolved once per document. The returned views live as long as this and the GLB chunk.
class Buffers {
 public:
  // In: the document (moved-from URIs are freed), and GLB's BIN chunk if there is one.
  // Errors: INVALID_ARGUMENT naming the buffer and its URI: only data: URIs and the chunk are read, never a file.
  static absl::StatusOr<Buffers> Resolve(Document& document, std::optional<std::span<const uint8_t>> chunk,
                                         Budget& budget);

  // The bytes of a buffer view; a meshopt-compressed one is decoded at first use. Errors: INVALID_ARGUMENT naming the
  // view; if it is decoded, also RESOURCE_EXHAUSTED and the job's.
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
