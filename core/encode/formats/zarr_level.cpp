#include "encode/formats/zarr_level.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <mutex>

#include "absl/strings/str_cat.h"
#include "encode/formats/deflate.h"
#include "encode/npy.h"

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

// In: a slab of `dims`. Out: two by two by two voxels as one: of each component the first of those whose bits in `mask`
// are the largest number. Without its sign, a float compares as an integer does.
template <typename T>
void Halve(const std::vector<uint8_t>& slab, const ZarrLevel::Dims& dims, uint64_t together, T mask,
           const ZarrLevel::Dims& half, std::vector<uint8_t>& out) {
  tbb::parallel_for(uint64_t{0}, half[0] * half[1], [&](uint64_t row) {
    const uint64_t k0 = row / half[1] * 2, j0 = row % half[1] * 2;
    uint8_t* to = &out[row * half[2] * together * sizeof(T)];
    std::memset(to, 0, half[2] * together * sizeof(T));
    for (uint64_t k = k0; k < std::min(k0 + 2, dims[0]); ++k) {
      for (uint64_t j = j0; j < std::min(j0 + 2, dims[1]); ++j) {
        const uint8_t* from = &slab[(k * dims[1] + j) * dims[2] * together * sizeof(T)];
        for (uint64_t i = 0; i < dims[2]; ++i) {
          for (uint64_t c = 0; c < together; ++c) {
            const T value = Load<T>(from + (i * together + c) * sizeof(T));
            uint8_t* const place = to + (i / 2 * together + c) * sizeof(T);
            if ((value & mask) > (Load<T>(place) & mask)) std::memcpy(place, &value, sizeof value);
          }
        }
      }
    }
  });
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
      job_(job) {}

ZarrLevel& ZarrLevel::AddHalf(std::string path) {
  const Dims half = {(dims_[0] + 1) / 2, (dims_[1] + 1) / 2, (dims_[2] + 1) / 2};
  half_ = std::make_unique<ZarrLevel>(std::move(path), type_, half, planes_, together_, parts_, job_);
  return *half_;
}

absl::Status ZarrLevel::Write(std::span<const uint8_t> bytes) {
  while (!bytes.empty()) {
    const uint64_t whole = SlabBytes();
    const std::span<const uint8_t> piece = bytes.first(size_t(std::min<uint64_t>(bytes.size(), whole - slab_.size())));
    slab_.insert(slab_.end(), piece.begin(), piece.end());
    bytes = bytes.subspan(piece.size());
    if (slab_.size() < whole) break;
    if (absl::Status s = WriteSlab(); !s.ok()) return s;
  }
  return absl::OkStatus();
}

absl::Status ZarrLevel::WriteSlab() {
  const uint64_t rows = (dims_[1] + chunk_[1] - 1) / chunk_[1], columns = (dims_[2] + chunk_[2] - 1) / chunk_[2];
  std::mutex mutex;
  absl::Status first;
  tbb::parallel_for(uint64_t{0}, together_ * rows * columns, [&](uint64_t n) {
    const absl::Status s = WriteChunk(n / columns / rows, n / columns % rows, n % columns);
    const std::lock_guard lock(mutex);
    first.Update(s);
  });
  if (!first.ok()) return first;
  if (half_ != nullptr) {
    if (absl::Status s = half_->Write(HalfOfSlab()); !s.ok()) return s;
  }
  layers_done_ += SlabLayers();
  slab_.clear();
  if (layers_done_ == dims_[0]) {
    layers_done_ = 0;
    ++planes_done_;
  }
  return absl::OkStatus();
}

// Chunks of Zarr are whole: those at the end of an axis are filled up with zeros. One of zeros only is left out.
absl::Status ZarrLevel::WriteChunk(uint64_t component, uint64_t row, uint64_t column) const {
  const uint64_t bytes = element_bytes_;
  const uint64_t layers = SlabLayers();
  const uint64_t y0 = row * chunk_[1], x0 = column * chunk_[2];
  const uint64_t ny = std::min(chunk_[1], dims_[1] - y0), nx = std::min(chunk_[2], dims_[2] - x0);
  std::vector<uint8_t> chunk(chunk_[0] * chunk_[1] * chunk_[2] * bytes);
  for (uint64_t k = 0; k < layers; ++k) {
    for (uint64_t j = 0; j < ny; ++j) {
      uint8_t* to = &chunk[(k * chunk_[1] + j) * chunk_[2] * bytes];
      const uint8_t* from = &slab_[(((k * dims_[1] + y0 + j) * dims_[2] + x0) * together_ + component) * bytes];
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
  return parts_.WriteFile(name, ZlibBlock(chunk), job_);
}

std::vector<uint8_t> ZarrLevel::HalfOfSlab() const {
  const Dims slab = {SlabLayers(), dims_[1], dims_[2]};
  const Dims half = {(slab[0] + 1) / 2, half_->dims_[1], half_->dims_[2]};
  std::vector<uint8_t> out(half[0] * half[1] * half[2] * together_ * element_bytes_);
  switch (type_) {
    case ElementType::kF16: Halve<uint16_t>(slab_, slab, together_, 0x7fff, half, out); break;
    case ElementType::kU16: Halve<uint16_t>(slab_, slab, together_, 0xffff, half, out); break;
    case ElementType::kF32: Halve<uint32_t>(slab_, slab, together_, 0x7fffffff, half, out); break;
    case ElementType::kU32: Halve<uint32_t>(slab_, slab, together_, 0xffffffff, half, out); break;
    default: Halve<uint8_t>(slab_, slab, together_, 0xff, half, out); break;  // bits are bytes here
  }
  return out;
}

}  // namespace voxelpipe
