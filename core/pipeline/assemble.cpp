#include "pipeline/assemble.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

namespace voxelpipe {
namespace {

uint64_t SlabVoxels(const GridSpec& grid, int64_t layers) {
  return uint64_t(grid.dims[0]) * uint64_t(grid.dims[1]) * uint64_t(layers);
}

// By all threads of the run: pages of the result are touched for the first time.
void Copy(uint8_t* to, const uint8_t* from, uint64_t bytes) {
  constexpr uint64_t kGrain = 1 << 20;
  tbb::parallel_for(tbb::blocked_range<uint64_t>(0, bytes, kGrain), [&](const tbb::blocked_range<uint64_t>& part) {
    std::memcpy(to + part.begin(), from + part.begin(), part.size());
  });
}

// Joins lists of elements that may be bits, end to end. `out` must be zero where bits are written.
class Joiner {
 public:
  Joiner(ElementType type, HostBuffer& out) : type_(type), out_(out.data()) {}

  void Append(const uint8_t* data, uint64_t count) {
    if (type_ != ElementType::kBit) {
      Copy(out_ + ArrayBytes(type_, at_), data, ArrayBytes(type_, count));
    } else {
      const unsigned shift = unsigned(at_ % 8);
      uint8_t* to = out_ + at_ / 8;
      for (uint64_t i = 0; i < (count + 7) / 8; ++i) {
        const unsigned valid = unsigned(std::min<uint64_t>(8, count - i * 8));
        to[i] |= uint8_t(data[i] << shift);
        if (shift + valid > 8) to[i + 1] |= uint8_t(data[i] >> (8 - shift));
      }
    }
    at_ += count;
  }

 private:
  ElementType type_;
  uint8_t* out_;
  uint64_t at_ = 0;  // elements
};

uint64_t ListedItems(const ResultArrays& slab, ResultKind kind, const std::vector<TargetSpec>& specs) {
  if (kind == ResultKind::kBuckets) return slab.triangles.size() / sizeof(uint32_t);
  for (size_t t = 0; t < specs.size(); ++t) {
    const uint64_t bytes = ArrayBytes(ElementOf(specs[t].format), uint64_t(specs[t].components));
    if (specs[t].format != VoxelFormat::kBit) return slab.targets[t].size() / bytes;
  }
  uint64_t count = 0;
  for (uint64_t i = 0; i < slab.masks.size(); i += sizeof(uint64_t)) {
    uint64_t word;
    std::memcpy(&word, slab.masks.data() + i, sizeof word);
    count += uint64_t(std::popcount(word));
  }
  return count;
}

// Joins one index array of all slabs and frees the parts.
absl::Status JoinIndex(std::vector<ResultArrays>& slabs, HostBuffer ResultArrays::*array, HostBuffer& out) {
  uint64_t bytes = 0;
  for (const ResultArrays& slab : slabs) bytes += (slab.*array).size();
  absl::StatusOr<HostBuffer> joined = HostBuffer::Allocate(bytes);
  if (!joined.ok()) return joined.status();
  uint64_t at = 0;
  for (ResultArrays& slab : slabs) {
    Copy(joined->data() + at, (slab.*array).data(), (slab.*array).size());
    at += (slab.*array).size();
    (slab.*array).Discard();
  }
  out = *std::move(joined);
  return absl::OkStatus();
}

// offset[i] of the whole: each slab's own, moved by the fragments before it; one entry more at the end.
absl::Status JoinOffsets(std::vector<ResultArrays>& slabs, HostBuffer& out) {
  uint64_t entries = 1;
  for (const ResultArrays& slab : slabs) entries += slab.offsets.size() / sizeof(uint64_t) - 1;
  absl::StatusOr<HostBuffer> joined = HostBuffer::Allocate(entries * sizeof(uint64_t));
  if (!joined.ok()) return joined.status();
  auto* to = reinterpret_cast<uint64_t*>(joined->data());
  uint64_t before = 0;
  for (ResultArrays& slab : slabs) {
    const auto* from = reinterpret_cast<const uint64_t*>(slab.offsets.data());
    const uint64_t count = slab.offsets.size() / sizeof(uint64_t) - 1;
    for (uint64_t i = 0; i < count; ++i) *to++ = before + from[i];
    before += from[count];
    slab.offsets.Discard();
  }
  *to = before;
  out = *std::move(joined);
  return absl::OkStatus();
}

absl::Status JoinTarget(std::vector<ResultArrays>& slabs, const std::vector<uint64_t>& items, const TargetSpec& spec,
                        Layout layout, size_t target, HostBuffer& out) {
  const ElementType type = ElementOf(spec.format);
  const uint64_t components = uint64_t(spec.components);
  uint64_t total = 0;
  for (const uint64_t count : items) total += count;
  absl::StatusOr<HostBuffer> joined = HostBuffer::Allocate(ArrayBytes(type, total * components));
  if (!joined.ok()) return joined.status();
  if (type == ElementType::kBit) std::fill_n(joined->data(), joined->size(), uint8_t{0});
  Joiner joiner(type, *joined);
  const uint64_t planes = layout == Layout::kPlanar ? components : 1;
  for (uint64_t plane = 0; plane < planes; ++plane) {
    for (size_t i = 0; i < slabs.size(); ++i) {
      const uint64_t count = items[i] * components / planes;
      joiner.Append(slabs[i].targets[target].data() + ArrayBytes(type, plane * count), count);
    }
  }
  for (ResultArrays& slab : slabs) slab.targets[target].Discard();
  out = *std::move(joined);
  return absl::OkStatus();
}

}  // namespace

absl::Status MemoryAssembler::Begin(const VoxelizeRequest& request, const Plan& plan, const PartTable& parts) {
  parts_ = &parts;
  one_slab_ = plan.slab_depth >= plan.grid.dims[2];
  if (request.result == ResultKind::kDense && !one_slab_) {
    absl::StatusOr<VoxelizeResult> result = AllocateResult(DenseHeader(request, plan.grid));
    if (!result.ok()) return result.status();
    result_ = *std::move(result);
    return absl::OkStatus();
  }
  result_.kind = request.result;
  result_.grid = plan.grid;
  result_.layout = request.layout;
  result_.specs = request.targets;
  return absl::OkStatus();
}

absl::Status MemoryAssembler::Add(int, const Slab& slab, ResultArrays arrays) {
  if (one_slab_) {
    static_cast<ResultArrays&>(result_) = std::move(arrays);
    return absl::OkStatus();
  }
  if (result_.kind != ResultKind::kDense) {
    slabs_.push_back(std::move(arrays));
    return absl::OkStatus();
  }
  const uint64_t before = SlabVoxels(result_.grid, slab.begin), here = SlabVoxels(result_.grid, slab.depth());
  for (size_t t = 0; t < result_.specs.size(); ++t) {
    const TargetSpec& spec = result_.specs[t];
    const ElementType type = ElementOf(spec.format);
    const uint64_t planes = result_.layout == Layout::kPlanar ? uint64_t(spec.components) : 1;
    const uint64_t per_voxel = uint64_t(spec.components) / planes;
    for (uint64_t plane = 0; plane < planes; ++plane) {
      const uint64_t to = plane * result_.grid.voxels() * per_voxel + before * per_voxel;
      Copy(result_.targets[t].data() + ArrayBytes(type, to),
           arrays.targets[t].data() + ArrayBytes(type, plane * here * per_voxel), ArrayBytes(type, here * per_voxel));
    }
  }
  return absl::OkStatus();
}

uint64_t MemoryAssembler::bytes_to_join() const {
  if (one_slab_ || result_.kind == ResultKind::kDense) return 0;
  // Arrays of one kind are joined and go before the next ones are.
  uint64_t largest = 0;
  const auto look = [&](const auto& bytes_of) {
    uint64_t bytes = 0;
    for (const ResultArrays& slab : slabs_) bytes += bytes_of(slab);
    largest = std::max(largest, bytes);
  };
  look([](const ResultArrays& slab) { return slab.bricks.size(); });
  look([](const ResultArrays& slab) { return slab.masks.size(); });
  look([](const ResultArrays& slab) { return slab.voxels.size(); });
  look([](const ResultArrays& slab) { return slab.offsets.size(); });
  look([](const ResultArrays& slab) { return slab.triangles.size(); });
  for (size_t t = 0; t < result_.specs.size(); ++t) {
    look([&](const ResultArrays& slab) { return slab.targets[t].size(); });
  }
  return largest;
}

absl::Status MemoryAssembler::End() {
  result_.parts = *parts_;
  if (one_slab_ || result_.kind == ResultKind::kDense) return absl::OkStatus();
  std::vector<uint64_t> items;
  for (const ResultArrays& slab : slabs_) items.push_back(ListedItems(slab, result_.kind, result_.specs));
  absl::Status s;
  if (result_.kind == ResultKind::kSparse) {
    if (s = JoinIndex(slabs_, &ResultArrays::bricks, result_.bricks); !s.ok()) return s;
    if (s = JoinIndex(slabs_, &ResultArrays::masks, result_.masks); !s.ok()) return s;
  } else {
    if (s = JoinIndex(slabs_, &ResultArrays::voxels, result_.voxels); !s.ok()) return s;
    if (s = JoinOffsets(slabs_, result_.offsets); !s.ok()) return s;
    if (s = JoinIndex(slabs_, &ResultArrays::triangles, result_.triangles); !s.ok()) return s;
  }
  result_.targets.resize(result_.specs.size());
  for (size_t t = 0; t < result_.specs.size(); ++t) {
    s = JoinTarget(slabs_, items, result_.specs[t], result_.layout, t, result_.targets[t]);
    if (!s.ok()) return s;
  }
  slabs_.clear();
  return absl::OkStatus();
}

absl::Status StreamAssembler::Begin(const VoxelizeRequest& request, const Plan& plan, const PartTable& parts) {
  parts_ = &parts;
  passes_.clear();
  all_at_once_.clear();
  for (size_t t = 0; t < request.targets.size(); ++t) {
    const int planes = request.layout == Layout::kPlanar ? request.targets[t].components : 1;
    for (int plane = 0; plane < planes; ++plane) passes_.push_back({t, plane, planes});
  }
  header_ = DenseHeader(request, plan.grid, parts.shape());
  if (plan.slab_depth < plan.grid.dims[2]) return sink_.Begin(header_);
  all_at_once_ = std::exchange(passes_, {Pass{0, 0, 1}});
  return absl::OkStatus();  // the sink may keep the whole
}

absl::Status StreamAssembler::Add(int pass, const Slab&, ResultArrays arrays) {
  const auto hand_on = [&](const Pass& part) -> absl::Status {
    const std::span<const uint8_t> all = std::as_const(arrays.targets[part.target]).bytes();
    const uint64_t bytes = all.size() / uint64_t(part.planes);
    return sink_.Write(part.target, all.subspan(uint64_t(part.plane) * bytes, bytes));
  };
  if (all_at_once_.empty()) return hand_on(passes_[size_t(pass)]);
  VoxelizeResult whole;
  whole.grid = header_.grid;
  whole.layout = header_.layout;
  whole.specs = header_.specs;
  whole.parts = *parts_;
  static_cast<ResultArrays&>(whole) = std::move(arrays);
  kept_ = sink_.Keep(std::move(whole));
  if (kept_) return absl::OkStatus();
  arrays = std::move(whole);  // NOLINT(bugprone-use-after-move): it was not kept
  if (absl::Status s = sink_.Begin(header_); !s.ok()) return s;
  for (const Pass& part : all_at_once_) {
    if (absl::Status s = hand_on(part); !s.ok()) return s;
  }
  return absl::OkStatus();
}

absl::Status StreamAssembler::End() {
  if (kept_ || parts_->empty()) return absl::OkStatus();
  PartTable parts = *parts_;
  size_t array = header_.first_part_array();
  for (const std::span<const uint8_t> bytes : ArraysOf(parts)) {
    if (absl::Status s = bytes.empty() ? absl::OkStatus() : sink_.Write(array, bytes); !s.ok()) return s;
    ++array;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
