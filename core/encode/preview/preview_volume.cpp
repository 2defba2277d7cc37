#include "encode/preview/preview_volume.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>

#include "encode/preview/preview_values.h"

namespace voxelpipe {
namespace {

// A volume of no more bits has them all: to look them up is faster than to search bricks.
constexpr uint64_t kSmallBitBytes = 16 << 20;

std::span<const uint64_t> Words(const HostBuffer& buffer) {
  return {reinterpret_cast<const uint64_t*>(buffer.data()), buffer.size() / sizeof(uint64_t)};
}

// The bits of the voxels with a component of the target other than `clear`.
absl::Status SetNotClear(const VoxelizeResult& result, size_t target, const JobContext* job,
                         std::vector<uint8_t>& bits) {
  const TargetSpec& spec = result.specs[target];
  const uint64_t voxels = result.grid.voxels();
  const TargetValues values(result, target, voxels);
  const uint32_t cell = NumberToCell(spec.clear, spec.format);
  const float clear = IsInteger(spec.format) ? float(cell) : FloatOf(cell);
  // Eight voxels that hold the very bits of `clear` are passed over at once: most of a grid is empty.
  const auto element = uint64_t(BitsPerComponent(spec.format) / 8), components = uint64_t(spec.components);
  const uint64_t planes = result.layout == Layout::kPlanar ? components : 1;
  const uint64_t run = 8 * element * components / planes;  // bytes of eight voxels in a plane
  std::vector<uint8_t> all_clear(run);
  const uint32_t stored = StoredBits(cell, spec.format);
  for (uint64_t at = 0; at < run; at += element) std::memcpy(&all_clear[at], &stored, element);  // little endian
  const auto is_clear = [&](uint64_t byte) {
    for (uint64_t plane = 0; plane < planes; ++plane) {
      const uint8_t* const first = result.targets[target].data() + plane * voxels * element + byte * run;
      if (std::memcmp(first, all_clear.data(), run) != 0) return false;
    }
    return !std::isnan(clear);  // which differs from itself
  };
  std::atomic<bool> stopped{false};
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, bits.size(), 1 << 14), [&](const auto& range) {
    JobPoll poll(job);
    for (uint64_t byte = range.begin(); byte < range.end(); ++byte) {
      if (!poll.Add(uint64_t(spec.components)).ok()) stopped = true;
      if (stopped) return;
      const uint64_t end = std::min(voxels, 8 * byte + 8);
      if (end == 8 * byte + 8 && is_clear(byte)) continue;
      for (uint64_t n = 8 * byte; n < end; ++n) {
        for (int c = 0; c < spec.components; ++c) {
          if (values.At(n, c) != clear) {
            bits[byte] |= uint8_t(1 << (n % 8));
            break;
          }
        }
      }
    }
  });
  return stopped ? job->Check() : absl::OkStatus();
}

// Calls set(i, j, k) for the voxels that a sparse or bucketed result lists.
template <typename Set>
absl::Status VisitListed(const VoxelizeResult& result, const JobContext* job, const Set& set) {
  JobPoll poll(job);
  const auto& dims = result.grid.dims;
  if (result.kind == ResultKind::kBuckets) {
    const auto nx = uint64_t(dims[0]), ny = uint64_t(dims[1]);
    for (const uint64_t n : Words(result.voxels)) {
      if (absl::Status s = poll.Add(1); !s.ok()) return s;
      if (absl::Status s = set(int64_t(n % nx), int64_t(n / nx % ny), int64_t(n / nx / ny)); !s.ok()) return s;
    }
    return absl::OkStatus();
  }
  const std::span<const uint64_t> bricks = Words(result.bricks);
  const uint64_t across = uint64_t(dims[0] + 7) / 8, rows = uint64_t(dims[1] + 7) / 8;
  for (uint64_t b = 0; b < bricks.size(); ++b) {
    const uint64_t x = 8 * (bricks[b] % across), y = 8 * (bricks[b] / across % rows),
                   z = 8 * (bricks[b] / across / rows);
    if (absl::Status s = poll.Add(64); !s.ok()) return s;
    for (uint64_t row = 0; row < 64; ++row) {
      const uint64_t j = y + row % 8, k = z + row / 8;
      if (j >= uint64_t(dims[1]) || k >= uint64_t(dims[2])) continue;
      for (unsigned mask = result.masks.data()[64 * b + row]; mask != 0; mask &= mask - 1) {
        const uint64_t i = x + uint64_t(std::countr_zero(mask));
        if (i >= uint64_t(dims[0])) continue;
        if (absl::Status s = set(int64_t(i), int64_t(j), int64_t(k)); !s.ok()) return s;
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace

PreviewVolume::PreviewVolume(const std::array<int64_t, 3>& dims, const JobContext* job)
    : dims_(dims), across_((dims[0] + 7) / 8), rows_((dims[1] + 7) / 8), layers_(dims[2]), memory_(&MemoryOf(job)) {}

uint64_t PreviewVolume::bit_bytes() const {
  return (uint64_t(dims_[0]) * uint64_t(dims_[1]) * uint64_t(dims_[2]) + 7) / 8;
}

bool PreviewVolume::WantsBits(uint64_t listed_bytes) const {
  return bit_bytes() <= std::max(kSmallBitBytes, 2 * listed_bytes);
}

absl::Status PreviewVolume::AllocateBits() {
  if (absl::Status s = memory_.Grow(bit_bytes(), "a bit a voxel:"); !s.ok()) return s;
  own_bits_.resize(bit_bytes());
  bits_ = own_bits_;
  return absl::OkStatus();
}

template <typename Each>
absl::Status PreviewVolume::MakeBits(const Each& each) {
  if (absl::Status s = AllocateBits(); !s.ok()) return s;
  return each([&](int64_t i, int64_t j, int64_t k) {
    const uint64_t n = Linear(i, j, k);
    own_bits_[n / 8] |= uint8_t(1 << (n % 8));
    return absl::OkStatus();
  });
}

absl::Status PreviewVolume::IndexBricks(const JobContext* job) {
  in_bricks_ = true;
  JobPoll poll(job);
  const auto layer = uint64_t(across_) * uint64_t(rows_);
  uint64_t groups = 0, end_of_group = 0;
  for (const uint64_t id : ids_) {
    if (id >= end_of_group) {
      ++groups;
      end_of_group = (id / layer + 1) * layer;
    }
    if (absl::Status s = poll.Add(1); !s.ok()) return s;
  }
  if (absl::Status s = memory_.Grow(groups, sizeof(Group), "the layers of bricks:"); !s.ok()) return s;
  groups_.reserve(groups);
  ChargedGrowth growth(MemoryOf(job), TableEntryBytes(2 * sizeof(uint64_t)), "an index of bricks:");
  if (absl::Status s = growth.Reach(ids_.size(), places_); !s.ok()) return s;
  memory_.Absorb(growth.TakeCharge());
  for (uint64_t b = 0; b < ids_.size(); ++b) {
    const auto z = int64_t(ids_[b] / layer);
    if (groups_.empty() || groups_.back().z != z) groups_.push_back({z, b});
    places_.emplace(ids_[b], b);
    if (absl::Status s = poll.Add(1); !s.ok()) return s;
  }
  layers_ = 8 * int64_t(groups_.size());
  if (!groups_.empty()) layers_ -= std::max<int64_t>(0, 8 * groups_.back().z + 8 - dims_[2]);
  return absl::OkStatus();
}

template <typename Each>
absl::Status PreviewVolume::MakeBricks(const JobContext* job, const Each& each) {
  {
    absl::flat_hash_map<uint64_t, uint64_t> known;
    ChargedGrowth growth(MemoryOf(job), TableEntryBytes(2 * sizeof(uint64_t)), "an index of bricks:");
    uint64_t last = std::numeric_limits<uint64_t>::max();
    absl::Status s = each([&](int64_t i, int64_t j, int64_t k) {
      const uint64_t id = BrickId(i / 8, j / 8, k / 8);
      if (std::exchange(last, id) == id) return absl::OkStatus();
      if (absl::Status full = growth.Reach(known.size() + 1, known); !full.ok()) return full;
      known.emplace(id, 0);
      return absl::OkStatus();
    });
    if (!s.ok()) return s;
    constexpr uint64_t kBrickBytes = 9 * sizeof(uint64_t);
    s = memory_.Grow(known.size(), kBrickBytes, "bricks:");
    if (!s.ok()) return s;
    own_ids_.reserve(known.size());
    for (const auto& [id, place] : known) own_ids_.push_back(id);
  }
  std::sort(own_ids_.begin(), own_ids_.end());
  own_masks_.resize(8 * own_ids_.size());
  ids_ = own_ids_;
  masks_ = own_masks_;
  if (absl::Status s = IndexBricks(job); !s.ok()) return s;
  uint64_t last = std::numeric_limits<uint64_t>::max(), place = 0;
  return each([&](int64_t i, int64_t j, int64_t k) {
    const uint64_t id = BrickId(i / 8, j / 8, k / 8);
    if (std::exchange(last, id) != id) place = places_.at(id);
    own_masks_[8 * place + uint64_t(k % 8)] |= uint64_t{1} << (8 * (j % 8) + i % 8);
    return absl::OkStatus();
  });
}

absl::StatusOr<PreviewVolume> PreviewVolume::Build(const VoxelizeResult& result, const JobContext* job) {
  if (result.targets.empty()) return absl::InvalidArgumentError("a drawing needs a result with at least one target");
  if (absl::Status status = CheckArrays(result, job); !status.ok()) return status;
  PreviewVolume volume(result.grid.dims, job);
  if (result.kind == ResultKind::kDense) {
    size_t shown = 0;
    for (size_t i = result.specs.size(); i-- > 0;) {
      if (result.specs[i].format == VoxelFormat::kBit) shown = i;
    }
    if (result.specs[shown].format == VoxelFormat::kBit) {
      volume.bits_ = result.targets[shown].bytes();
      return volume;
    }
    absl::Status status = volume.AllocateBits();
    if (status.ok()) status = SetNotClear(result, shown, job, volume.own_bits_);
    if (!status.ok()) return status;
    return volume;
  }
  const auto each = [&](const auto& set) { return VisitListed(result, job, set); };
  absl::Status status;
  if (volume.WantsBits(result.voxels.size() + result.masks.size())) {
    status = volume.MakeBits(each);
  } else if (result.kind == ResultKind::kSparse) {
    volume.ids_ = Words(result.bricks);
    volume.masks_ = Words(result.masks);
    status = volume.IndexBricks(job);
  } else {
    status = volume.MakeBricks(job, each);
  }
  if (!status.ok()) return status;
  return volume;
}

absl::StatusOr<PreviewVolume> PreviewVolume::Halved(const PreviewVolume& fine, const JobContext* job) {
  std::array<int64_t, 3> dims{};
  for (size_t a = 0; a < 3; ++a) dims[a] = (fine.dims()[a] + 1) / 2;
  PreviewVolume volume(dims, job);
  const auto each = [&](const auto& set) {
    JobPoll poll(job);
    absl::Status status;
    for (int64_t n = 0; n < fine.layers() && status.ok(); ++n) {
      const int64_t k = fine.Layer(n);
      const absl::Status walked = fine.VisitRows(k, poll, [&](int64_t i, int64_t j, uint32_t word) {
        word |= word >> 1;  // a word begins at an even voxel
        for (word &= 0x55555555; word != 0 && status.ok(); word &= word - 1) {
          status = set((i + std::countr_zero(word)) / 2, j / 2, k / 2);
        }
      });
      status.Update(walked);
    }
    return status;
  };
  absl::Status status;
  if (!fine.in_bricks() || volume.WantsBits(fine.masks_.size_bytes())) {
    status = volume.MakeBits(each);
  } else {
    status = volume.MakeBricks(job, each);
  }
  if (!status.ok()) return status;
  return volume;
}

int64_t PreviewVolume::FirstLayer(int64_t k) const {
  if (!in_bricks_) return std::min(k, layers_);
  const auto found = std::lower_bound(groups_.begin(), groups_.end(), k / 8,
                                      [](const Group& group, int64_t z) { return group.z < z; });
  const int64_t n = 8 * (found - groups_.begin());
  return std::min(layers_, found != groups_.end() && found->z == k / 8 ? n + k % 8 : n);
}

std::pair<size_t, size_t> PreviewVolume::BricksOfLayer(int64_t k) const {
  const auto found = std::lower_bound(groups_.begin(), groups_.end(), k / 8,
                                      [](const Group& group, int64_t z) { return group.z < z; });
  if (found == groups_.end() || found->z != k / 8) return {0, 0};
  return {found->first, found + 1 == groups_.end() ? ids_.size() : (found + 1)->first};
}

uint32_t PreviewVolume::Row(int64_t i, int64_t j, int64_t k, int count) const {
  if (j < 0 || k < 0 || j >= dims_[1] || k >= dims_[2] || i >= dims_[0] || i + count <= 0) return 0;
  if (in_bricks_) return RowOfBricks(i, j, k, count);
  const int skipped = i < 0 ? int(-i) : 0;
  const int64_t first = i + skipped;
  const int taken = int(std::min<int64_t>(count - skipped, dims_[0] - first));
  const uint64_t bit = Linear(first, j, k);
  uint64_t word = 0;
  if (bit / 8 + sizeof(word) <= bits_.size()) {
    std::memcpy(&word, bits_.data() + bit / 8, sizeof(word));  // of a constant size: one load
  } else {
    std::memcpy(&word, bits_.data() + bit / 8, bits_.size() - bit / 8);
  }
  return uint32_t(((word >> (bit % 8)) & ((uint64_t{1} << taken) - 1)) << skipped);
}

uint32_t PreviewVolume::RowOfBricks(int64_t i, int64_t j, int64_t k, int count) const {
  const int64_t begin = std::max<int64_t>(0, i), end = std::min(i + count, dims_[0]);
  uint64_t word = 0;  // of the voxels from `low` on
  const int64_t low = begin / 8 * 8;
  for (int64_t x = low; x < end; x += 8) {
    const uint64_t* const brick = FindBrick(x / 8, j / 8, k / 8);
    if (brick != nullptr) word |= ((brick[k % 8] >> (8 * (j % 8))) & 255) << (x - low);
  }
  word = (word >> (begin - low)) & ((uint64_t{1} << (end - begin)) - 1);
  return uint32_t(word << (begin - i));
}

}  // namespace voxelpipe
