// Pinned host memory, for copies at the full speed of the bus.
#pragma once

#include <driver_types.h>

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe::cuda {

// A block of host memory to copy through, contents undefined, 64-byte aligned, from a process-wide pool of pinned
// blocks. It is pageable memory if the pool is at its limit or the system refuses to pin more. The destructor returns
// it to the pool: the device must be done with it. Movable.
class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  PinnedBuffer(PinnedBuffer&& other) noexcept { *this = static_cast<PinnedBuffer&&>(other); }
  PinnedBuffer& operator=(PinnedBuffer&& other) noexcept;
  ~PinnedBuffer() { Release(); }

  // RESOURCE_EXHAUSTED names the size if the system has no memory for it. Thread-safe.
  static absl::StatusOr<PinnedBuffer> Take(uint64_t bytes);

  static PinnedBuffer Own(uint8_t* block, uint64_t bytes);  // a pinned block of that pool

  uint8_t* data() { return data_; }
  const uint8_t* data() const { return data_; }
  uint64_t size() const { return size_; }
  bool pinned() const { return pinned_; }

 private:
  void Release();

  uint8_t* data_ = nullptr;
  uint64_t size_ = 0;
  bool pinned_ = false;
};

// Copies to the device in `stream` order through pinned memory, which is added to `staged` and must live until that
// work is done. Threads of the calling thread's arena fill it while the device already reads.
absl::Status StagedCopy(void* to, const void* from, uint64_t bytes, cudaStream_t stream,
                        std::vector<PinnedBuffer>& staged);

// Copies from the device in `stream` order to pageable memory, through pieces of pinned memory if it is much: threads
// of the calling thread's arena, which touch fresh pages, empty them while the device goes on, and the call waits for
// the last one. `to` is in use until the stream's work is done, even after an error.
absl::Status ReadBack(void* to, const void* from, uint64_t bytes, cudaStream_t stream);

// The pool of results: a pinned block of at least `bytes`, or nullptr. Thread-safe.
void* TakePinned(uint64_t bytes);
void ReturnPinned(void* block, uint64_t bytes);

// Releases idle blocks to the system now, and blocks in use when they return. Called before a device reset.
void ForgetPinned();

// Of both pools.
struct PinnedUse {
  uint64_t bytes = 0, idle_bytes = 0, most_bytes = 0;  // pinned in all, idle of them, and the limit
};
PinnedUse PinnedInUse();

}  // namespace voxelpipe::cuda
