// A level of an OME-Zarr image: an array of compressed chunks, and the levels of half the resolution below it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "encode/atomic_directory.h"
#include "job/result.h"

namespace voxelpipe {

class ZarrLevel {
 public:
  using Dims = std::array<uint64_t, 3>;  // z, y, x

  // `path`: of the array in the directory, "target0/0/". `planes`: arrays that arrive one after the other, each with
  // `together` interleaved components; one of the two is 1. `parts`: the directory; it and `job` must outlive the
  // level.
  ZarrLevel(std::string path, ElementType type, const Dims& dims, uint64_t planes, uint64_t together,
            const AtomicDirectory& parts, const JobContext* job);

  // The level of half the resolution, rounded up; created here. A voxel of it has, a component, the value of the
  // largest magnitude of its up to eight voxels, so that thin surfaces do not disappear.
  ZarrLevel& AddHalf(std::string path);

  // The next elements, as in a .npy (NpyElements). Writes each row of chunks that is complete. Errors: the system's,
  // the job's, and those of its memory, to which the layers of a row of chunks are charged: bits are kept as bits.
  absl::Status Write(std::span<const uint8_t> bytes);

  bool complete() const { return planes_done_ == planes_; }
  const Dims& dims() const { return dims_; }
  const Dims& chunk() const { return chunk_; }

 private:
  uint64_t SlabLayers() const { return std::min(chunk_[0], dims_[0] - layers_done_); }
  // Elements of a row along x; of the layers of a row of chunks.
  uint64_t RowElements() const { return dims_[2] * together_; }
  uint64_t SlabElements() const { return SlabLayers() * dims_[1] * RowElements(); }
  absl::Status Begin();
  void Append(std::span<const uint8_t> bytes);
  // Row j of layer k of the slab. `space`, of a row, is used for bits.
  const uint8_t* Row(uint64_t k, uint64_t j, std::vector<uint8_t>& space) const;
  absl::Status WriteSlab();
  absl::Status WriteChunk(uint64_t component, uint64_t row, uint64_t column) const;
  absl::Status WriteHalf();
  template <typename T>
  void HalveLayer(uint64_t layer, T mask, std::vector<uint8_t>& out) const;

  std::string path_;
  ElementType type_;
  Dims dims_, chunk_;
  uint64_t planes_, together_, element_bytes_;
  const AtomicDirectory& parts_;
  const JobContext* job_;
  MemoryCharge memory_;
  bool begun_ = false;
  std::vector<uint8_t> slab_;  // layers that wait for a row of chunks; element n of bits is bit n%8 of byte n/8
  uint64_t slab_bits_ = 0;     // of bits, the elements in it
  uint64_t planes_done_ = 0, layers_done_ = 0;  // layers of the present plane
  std::unique_ptr<ZarrLevel> half_;
};

}  // namespace voxelpipe
