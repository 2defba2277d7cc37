#include "encode/formats/zarr_level.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <mutex>

#include "absl/strings/str_cat.h"
#include "encode/formats/deflate.h"
#include "encode/npy.h"
#include "job/job_work.h"

namespace voxelpipe {
namespace {

constexpr ZarrLevel::Dims kMaxChunk = {16, 256, 256};  // an even number of layers, so that a slab's half is whole

ZarrLevel::Dims ChunkOf(const ZarrLevel::Dims& dims) {
  return {std::min(kMaxChunk[0], dims[0]), std::min(kMaxChunk[1], dims[1]), std::min(kMaxChunk[2], dims[2])};
}

template <typename T>
T Load(const uint8_t* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

// Bits `first` to `first` + `count` of `bits` as bytes 0 or 1.
void Unpack(const std::vector<uint8_t>& bits, uint64_t first, uint64_t count, uint8_t* to) {
  uint64_t i = 0;
  for (; i + 8 <= count; i += 8) {
    const uint64_t at = (first + i) / 8, shift = (first + i) % 8;
    const uint64_t eight = (bits[at] >> shift | (shift == 0 ? 0 : bits[at + 1] << (8 - shift))) & 255;
    // Byte b of `spread` is 2^b or 0; the sum carries into its highest bit.
    const uint64_t spread = (eight * 0x0101010101010101) & 0x8040201008040201;
    const uint64_t bytes = ((spread + 0x00406070787c7e7f) >> 7) & 0x0101010101010101;
    std::memcpy(to + i, &bytes, sizeof bytes);
  }
  for (; i < count; ++i) to[i] = bits[(first + i) / 8] >> ((first + i) % 8) & 1;
}

}  // namespace

ZarrLevel::ZarrLevel(std::string path, ElementType type, const Dims& dims, uint64_t planes, uint64_t together,
                     const AtomicDirectory& parts, const JobContext* job)
    : path_(std::move(path)),
      type_(type),
      dims_(dims),
      chunk_(ChunkOf(dims)),
      planes_(planes),
      together_(together),
      element_bytes_(NpyBytes(type, 1)),
      parts_(parts),
      job_(job),
      memory_(&MemoryOf(job)) {}

ZarrLevel& ZarrLevel::AddHalf(std::string path) {
  const Dims half = {(dims_[0] + 1) / 2, (dims_[1] + 1) / 2, (dims_[2] + 1) / 2};
  half_ = std::make_unique<ZarrLevel>(std::move(path), type_, half, planes_, together_, parts_, job_);
  return *half_;
}

absl::Status ZarrLevel::Begin() {
  const uint64_t slab = ArrayBytes(type_, SlabElements());
  if (absl::Status s = memory_.Grow(slab, "a row of chunks:"); !s.ok()) return s;
  slab_.reserve(slab);
  begun_ = true;
  return absl::OkStatus();
}

void ZarrLevel::Append(std::span<const uint8_t> bytes) {
  if (type_ != ElementType::kBit) {
    slab_.insert(slab_.end(), bytes.begin(), bytes.end());
    return;
  }
  slab_.resize(ArrayBytes(type_, slab_bits_ + bytes.size()));
  while (!bytes.empty()) {
    if (slab_bits_ % 8 == 0 && bytes.size() >= 8) {
      uint64_t eight;
      std::memcpy(&eight, bytes.data(), sizeof eight);
      slab_[slab_bits_ / 8] = uint8_t((eight * 0x0102040810204080) >> 56);  // byte b becomes bit b
      slab_bits_ += 8;
      bytes = bytes.subspan(8);
      continue;
    }
    slab_[slab_bits_ / 8] |= uint8_t(bytes[0] << (slab_bits_ % 8));
    ++slab_bits_;
    bytes = bytes.subspan(1);
  }
}

absl::Status ZarrLevel::Write(std::span<const uint8_t> bytes) {
  if (!begun_) {
    if (absl::Status s = Begin(); !s.ok()) return s;
  }
  constexpr uint64_t kPieceBytes = 8 << 20;  // between two looks at the job
  while (!bytes.empty()) {
    if (absl::Status s = CheckJob(job_); !s.ok()) return s;
    // A piece may end within an element.
    const uint64_t held = type_ == ElementType::kBit ? slab_bits_ : slab_.size();
    const uint64_t left = SlabElements() * element_bytes_ - held;
    const std::span<const uint8_t> piece = bytes.first(size_t(std::min({uint64_t(bytes.size()), left, kPieceBytes})));
    Append(piece);
    bytes = bytes.subspan(piece.size());
    if (piece.size() < left) continue;
    if (absl::Status s = WriteSlab(); !s.ok()) return s;
  }
  return absl::OkStatus();
}

const uint8_t* ZarrLevel::Row(uint64_t k, uint64_t j, std::vector<uint8_t>& space) const {
  const uint64_t first = (k * dims_[1] + j) * RowElements();
  if (type_ != ElementType::kBit) return &slab_[first * element_bytes_];
  space.resize(RowElements());
  Unpack(slab_, first, space.size(), space.data());
  return space.data();
}

absl::Status ZarrLevel::WriteSlab() {
  const uint64_t rows = (dims_[1] + chunk_[1] - 1) / chunk_[1], columns = (dims_[2] + chunk_[2] - 1) / chunk_[2];
  const uint64_t chunk = NpyBytes(type_, chunk_[0] * chunk_[1] * chunk_[2]);
  const auto threads = uint64_t(tbb::this_task_arena::max_concurrency());
  const uint64_t row = type_ == ElementType::kBit ? RowElements() : 0;
  const uint64_t chunk_bytes = chunk + ZlibBlockBytes(chunk) + row;
  MemoryCharge chunks(&MemoryOf(job_));
  absl::Status first = chunks.Grow(std::min(threads, together_ * rows * columns), chunk_bytes, "chunks:");
  if (!first.ok()) return first;
  std::mutex mutex;
  std::atomic<bool> failed{false};
  tbb::parallel_for(uint64_t{0}, together_ * rows * columns, [&](uint64_t n) {
    if (failed) return;
    absl::Status s = CheckJob(job_);
    if (s.ok()) s = WriteChunk(n / columns / rows, n / columns % rows, n % columns);
    if (s.ok()) return;
    failed = true;
    const std::lock_guard lock(mutex);
    first.Update(s);
  });
  if (!first.ok()) return first;
  chunks.ShrinkTo(0);
  if (half_ != nullptr) {
    if (absl::Status s = WriteHalf(); !s.ok()) return s;
  }
  layers_done_ += SlabLayers();
  slab_.clear();
  slab_bits_ = 0;
  if (layers_done_ == dims_[0]) {
    layers_done_ = 0;
    ++planes_done_;
  }
  if (complete()) {
    slab_ = {};
    memory_.ShrinkTo(0);
  }
  return absl::OkStatus();
}

// Chunks of Zarr are whole: those at the end of an axis are filled up with zeros. One of zeros only is left out.
absl::Status ZarrLevel::WriteChunk(uint64_t component, uint64_t row, uint64_t column) const {
  const uint64_t bytes = element_bytes_;
  const uint64_t layers = SlabLayers();
  const uint64_t y0 = row * chunk_[1], x0 = column * chunk_[2];
  const uint64_t ny = std::min(chunk_[1], dims_[1] - y0), nx = std::min(chunk_[2], dims_[2] - x0);
  std::vector<uint8_t> chunk(chunk_[0] * chunk_[1] * chunk_[2] * bytes), space;
  for (uint64_t k = 0; k < layers; ++k) {
    for (uint64_t j = 0; j < ny; ++j) {
      uint8_t* to = &chunk[(k * chunk_[1] + j) * chunk_[2] * bytes];
      if (type_ == ElementType::kBit && together_ == 1) {
        Unpack(slab_, (k * dims_[1] + y0 + j) * dims_[2] + x0, nx, to);
        continue;
      }
      const uint8_t* from = Row(k, y0 + j, space) + (x0 * together_ + component) * bytes;
      if (together_ == 1) {
        std::memcpy(to, from, nx * bytes);
        continue;
      }
      for (uint64_t i = 0; i < nx; ++i, to += bytes, from += together_ * bytes) std::memcpy(to, from, bytes);
    }
  }
  if (std::all_of(chunk.begin(), chunk.end(), [](uint8_t byte) { return byte == 0; })) return absl::OkStatus();
  std::string name = path_;
  if (together_ * planes_ > 1) absl::StrAppend(&name, together_ > 1 ? component : planes_done_, "/");
  absl::StrAppend(&name, layers_done_ / chunk_[0], "/", row, "/", column);
  const absl::StatusOr<std::vector<uint8_t>> block = ZlibBlock(chunk, job_);
  return block.ok() ? parts_.WriteFile(name, *block, job_) : block.status();
}

// Layer `layer` of the half: two by two by two voxels as one, of each component the first of those whose bits in `mask`
// are the largest number. Without its sign, a float compares as an integer does.
template <typename T>
void ZarrLevel::HalveLayer(uint64_t layer, T mask, std::vector<uint8_t>& out) const {
  const uint64_t layers = SlabLayers();
  tbb::parallel_for(uint64_t{0}, half_->dims_[1], [&](uint64_t row) {
    std::vector<uint8_t> space;
    const uint64_t k0 = layer * 2, j0 = row * 2;
    uint8_t* to = &out[row * half_->RowElements() * sizeof(T)];
    std::memset(to, 0, half_->RowElements() * sizeof(T));
    for (uint64_t k = k0; k < std::min(k0 + 2, layers); ++k) {
      for (uint64_t j = j0; j < std::min(j0 + 2, dims_[1]); ++j) {
        const uint8_t* from = Row(k, j, space);
        for (uint64_t i = 0; i < dims_[2]; ++i) {
          for (uint64_t c = 0; c < together_; ++c) {
            const T value = Load<T>(from + (i * together_ + c) * sizeof(T));
            uint8_t* const place = to + (i / 2 * together_ + c) * sizeof(T);
            if ((value & mask) > (Load<T>(place) & mask)) std::memcpy(place, &value, sizeof value);
          }
        }
      }
    }
  });
}

absl::Status ZarrLevel::WriteHalf() {
  const auto threads = uint64_t(tbb::this_task_arena::max_concurrency());
  const uint64_t layer_bytes = half_->dims_[1] * half_->RowElements() * element_bytes_;
  const uint64_t row = type_ == ElementType::kBit ? RowElements() : 0;
  MemoryCharge memory(&MemoryOf(job_));
  if (absl::Status s = memory.Grow(layer_bytes + threads * row, "half a layer:"); !s.ok()) return s;
  std::vector<uint8_t> out(layer_bytes);
  for (uint64_t layer = 0; layer < (SlabLayers() + 1) / 2; ++layer) {
    if (absl::Status s = CheckJob(job_); !s.ok()) return s;
    switch (type_) {
      case ElementType::kF16: HalveLayer<uint16_t>(layer, 0x7fff, out); break;
      case ElementType::kU16: HalveLayer<uint16_t>(layer, 0xffff, out); break;
      case ElementType::kF32: HalveLayer<uint32_t>(layer, 0x7fffffff, out); break;
      case ElementType::kU32: HalveLayer<uint32_t>(layer, 0xffffffff, out); break;
      default: HalveLayer<uint8_t>(layer, 0xff, out); break;  // bits are bytes here
    }
    if (absl::Status s = half_->Write(out); !s.ok()) return s;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
