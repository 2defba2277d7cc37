// The process-wide pools of pinned host memory, and staged copies to a device through them.
#include "cuda/device/pinned.h"

#include <cuda_runtime_api.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <deque>
#include <mutex>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/machine.h"
#include "cuda/device/check.h"
#include "grid/page_pool.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint64_t kMinStaged = 256 << 10;             // smaller copies: the driver's own staging is as fast
constexpr uint64_t kWave = 8 << 20, kGrain = 1 << 20;  // copied by all threads; by one thread
// Copies from the device in pieces, of which so many take an eighth of the result at most.
constexpr uint64_t kPieces = 4, kMinPiece = 1 << 20, kMaxPiece = 16 << 20, kMinInPieces = 8 * kPieces * kMinPiece;
constexpr uint64_t kMinBytes = 64 << 10;
// Bounds of the two pools, and divisors of the machine's memory, whichever is less.
constexpr uint64_t kMaxResults = 16ull << 30, kShareOfResults = 16;
constexpr uint64_t kMaxStaged = 2ull << 30, kShareOfStaged = 32;

// Rounds up to four sizes per octave, so that blocks are reused and waste at most a fifth.
uint64_t BlockBytes(uint64_t bytes) {
  if (bytes <= kMinBytes) return kMinBytes;
  const uint64_t step = std::max(std::bit_floor(bytes - 1), kMinBytes) / 4;
  return (bytes + step - 1) / step * step;
}

// Pool of pinned blocks from the page pool. A block that is no longer pinned when it returns is still ordinary memory.
class Pool {
 public:
  explicit Pool(uint64_t most) : most_(most) {}

  void* Take(uint64_t size) {
    std::unique_lock lock(mutex_);
    for (auto block = idle_.rbegin(); block != idle_.rend(); ++block) {
      if (block->size != size) continue;
      void* const address = block->address;
      idle_bytes_ -= size;
      idle_.erase(std::next(block).base());
      return address;
    }
    if (size > most_) return nullptr;
    while (bytes_ + size > most_ && !idle_.empty()) DropOldest();
    if (bytes_ + size > most_) return nullptr;
    bytes_ += size;
    const uint64_t generation = generation_;
    lock.unlock();  // pinning is slow
    void* const address = TakePages(size);
    const bool pinned = address != nullptr && cudaHostRegister(address, size, cudaHostRegisterPortable) == cudaSuccess;
    if (!pinned) {
      (void)cudaGetLastError();  // clears the error, which is not the caller's
      ReturnPages(address, size);
    }
    lock.lock();
    if (pinned) {
      out_.emplace(address, generation);
      return address;
    }
    bytes_ -= size;
    return nullptr;
  }

  void Return(void* address, uint64_t size) {
    const std::lock_guard lock(mutex_);
    const auto out = out_.find(address);
    if (out != out_.end() && out->second != generation_) {  // a device reset unpinned it
      out_.erase(out);
      Unpin({address, size});
      return;
    }
    idle_.push_back({address, size});
    idle_bytes_ += size;
  }

  void Forget() {
    const std::lock_guard lock(mutex_);
    while (!idle_.empty()) DropOldest();
    ++generation_;
  }

  PinnedUse Use() {
    const std::lock_guard lock(mutex_);
    return {bytes_, idle_bytes_, most_};
  }

 private:
  struct Block {
    void* address;
    uint64_t size;
  };

  void Unpin(const Block& block) {
    if (cudaHostUnregister(block.address) != cudaSuccess) (void)cudaGetLastError();  // not pinned after a reset
    ReturnPages(block.address, block.size);
    bytes_ -= block.size;
  }
  void DropOldest() {
    const Block block = idle_.front();
    idle_.pop_front();
    idle_bytes_ -= block.size;
    out_.erase(block.address);
    Unpin(block);
  }

  std::mutex mutex_;
  std::deque<Block> idle_;                   // oldest first
  std::unordered_map<void*, uint64_t> out_;  // all pinned blocks, with the generation that pinned them
  uint64_t bytes_ = 0, idle_bytes_ = 0, generation_ = 0;
  const uint64_t most_;
};

// Results and what is staged have a pool each: an upload of a megabyte would otherwise take the place of a result that
// fills the pool, which the call then copies to pageable memory, four times as slowly. Never destroyed: buffers may
// outlive static objects.
Pool& Results() {
  static Pool* const pool = new Pool(std::min(kMaxResults, MemoryBytes() / kShareOfResults));
  return *pool;
}
Pool& Staged() {
  static Pool* const pool = new Pool(std::min(kMaxStaged, MemoryBytes() / kShareOfStaged));
  return *pool;
}

void* TakeFrom(Pool& pool, uint64_t bytes) {
  return bytes > kMaxResults ? nullptr : pool.Take(BlockBytes(bytes));  // rounding up could overflow
}

// With the threads of the calling thread's arena.
void CopyHere(uint8_t* to, const uint8_t* from, uint64_t bytes) {
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, bytes, kGrain), [&](const tbb::blocked_range<uint64_t>& part) {
    std::memcpy(to + part.begin(), from + part.begin(), part.size());
  });
}

// A block of pinned memory through which a part of a result is copied.
struct Piece {
  Piece() = default;
  Piece(const Piece&) = delete;
  Piece& operator=(const Piece&) = delete;
  ~Piece() {
    if (arrived != nullptr) (void)cudaEventDestroy(arrived);
  }
  PinnedBuffer buffer;
  cudaEvent_t arrived = nullptr;
};
using Pieces = std::array<Piece, kPieces>;

absl::Status ReadBackBy(Pieces& pieces, uint8_t* to, const uint8_t* from, uint64_t bytes, cudaStream_t stream) {
  const uint64_t each = pieces[0].buffer.size(), count = (bytes + each - 1) / each;
  const auto bytes_of = [=](uint64_t i) { return std::min(each, bytes - i * each); };
  const auto start = [&](uint64_t i) -> absl::Status {
    Piece& piece = pieces[i % kPieces];
    VOXELPIPE_CUDA_OR_RETURN(
        cudaMemcpyAsync(piece.buffer.data(), from + i * each, bytes_of(i), cudaMemcpyDeviceToHost, stream));
    VOXELPIPE_CUDA_OR_RETURN(cudaEventRecord(piece.arrived, stream));
    return absl::OkStatus();
  };
  for (uint64_t i = 0; i < std::min(count, kPieces); ++i) VOXELPIPE_OK_OR_RETURN(start(i));
  for (uint64_t i = 0; i < count; ++i) {
    Piece& piece = pieces[i % kPieces];
    VOXELPIPE_CUDA_OR_RETURN(cudaEventSynchronize(piece.arrived));
    CopyHere(to + i * each, piece.buffer.data(), bytes_of(i));
    if (i + kPieces < count) VOXELPIPE_OK_OR_RETURN(start(i + kPieces));
  }
  return absl::OkStatus();
}

}  // namespace

void* TakePinned(uint64_t bytes) {
  return TakeFrom(Results(), bytes);
}
void ReturnPinned(void* block, uint64_t bytes) {
  Results().Return(block, BlockBytes(bytes));
}
void ForgetPinned() {
  Results().Forget();
  Staged().Forget();
}
PinnedUse PinnedInUse() {
  const PinnedUse results = Results().Use(), staged = Staged().Use();
  return {results.bytes + staged.bytes, results.idle_bytes + staged.idle_bytes, results.most_bytes + staged.most_bytes};
}

PinnedBuffer& PinnedBuffer::operator=(PinnedBuffer&& other) noexcept {
  if (this == &other) return *this;
  Release();
  data_ = std::exchange(other.data_, nullptr);
  size_ = std::exchange(other.size_, 0);
  pinned_ = std::exchange(other.pinned_, false);
  return *this;
}

PinnedBuffer PinnedBuffer::Own(uint8_t* block, uint64_t bytes) {
  PinnedBuffer buffer;
  buffer.data_ = block;
  buffer.size_ = bytes;
  buffer.pinned_ = true;
  return buffer;
}

absl::StatusOr<PinnedBuffer> PinnedBuffer::Take(uint64_t bytes) {
  PinnedBuffer buffer;
  buffer.size_ = bytes;
  buffer.data_ = static_cast<uint8_t*>(TakeFrom(Staged(), bytes));
  buffer.pinned_ = buffer.data_ != nullptr;
  if (!buffer.pinned_) buffer.data_ = static_cast<uint8_t*>(TakePages(bytes));
  if (buffer.data_ == nullptr) {
    return absl::ResourceExhaustedError(absl::StrCat("out of memory: no ", bytes, " bytes to copy through"));
  }
  return buffer;
}

absl::Status StagedCopy(void* to, const void* from, uint64_t bytes, cudaStream_t stream,
                        std::vector<PinnedBuffer>& staged) {
  if (bytes == 0) return absl::OkStatus();
  auto* const there = static_cast<uint8_t*>(to);
  const auto* const here = static_cast<const uint8_t*>(from);
  auto* const between = bytes < kMinStaged ? nullptr : static_cast<uint8_t*>(TakeFrom(Staged(), bytes));
  if (between == nullptr) {  // the driver stages it
    VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(to, from, bytes, cudaMemcpyHostToDevice, stream));
    return absl::OkStatus();
  }
  staged.push_back(PinnedBuffer::Own(between, bytes));
  for (uint64_t begin = 0; begin < bytes; begin += kWave) {
    const uint64_t end = std::min(bytes, begin + kWave);
    CopyHere(between + begin, here + begin, end - begin);
    VOXELPIPE_CUDA_OR_RETURN(
        cudaMemcpyAsync(there + begin, between + begin, end - begin, cudaMemcpyHostToDevice, stream));
  }
  return absl::OkStatus();
}

absl::Status ReadBack(void* to, const void* from, uint64_t bytes, cudaStream_t stream) {
  Pieces pieces;
  const uint64_t each = std::min(kMaxPiece, bytes / (8 * kPieces) / kMinPiece * kMinPiece);
  bool staged = bytes >= kMinInPieces;
  for (Piece& piece : pieces) {
    void* const block = staged ? TakeFrom(Staged(), each) : nullptr;
    staged = block != nullptr;
    if (!staged) break;
    piece.buffer = PinnedBuffer::Own(static_cast<uint8_t*>(block), each);
    VOXELPIPE_CUDA_OR_RETURN(cudaEventCreateWithFlags(&piece.arrived, cudaEventDisableTiming));
  }
  if (!staged) {  // the driver stages it
    VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToHost, stream));
    return absl::OkStatus();
  }
  absl::Status s = ReadBackBy(pieces, static_cast<uint8_t*>(to), static_cast<const uint8_t*>(from), bytes, stream);
  // After an error copies into the pieces may still be in progress.
  if (!s.ok() && cudaStreamSynchronize(stream) != cudaSuccess) (void)cudaGetLastError();
  return s;
}

void PinnedBuffer::Release() {
  if (data_ == nullptr) return;
  if (pinned_) {
    Staged().Return(data_, BlockBytes(size_));
  } else {
    ReturnPages(data_, size_);
  }
  data_ = nullptr;
}

}  // namespace voxelpipe::cuda
