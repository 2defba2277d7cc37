#include "encode/preview/preview_values.h"

#include <algorithm>
#include <bit>
#include <span>

#include "absl/strings/str_cat.h"
#include "job/job_work.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kBrick = 8, kMaskWords = kBrick;  // a word is a plane z of a brick's mask

std::span<const uint64_t> Words(const HostBuffer& buffer) {
  return {reinterpret_cast<const uint64_t*>(buffer.data()), buffer.size() / sizeof(uint64_t)};
}

absl::Status Malformed(std::string_view array) {
  return absl::InvalidArgumentError(absl::StrCat("preview: array '", std::string(array), "' does not fit the result"));
}

// OK if the values ascend and are below `limit`.
absl::Status CheckAscends(std::span<const uint64_t> values, uint64_t limit, std::string_view array,
                          const JobContext* job) {
  JobPoll poll(job);
  for (size_t i = 1; i < values.size(); ++i) {
    if (values[i] <= values[i - 1]) return Malformed(array);
    if (absl::Status s = poll.Add(1); !s.ok()) return s;
  }
  return values.empty() || values.back() < limit ? absl::OkStatus() : Malformed(array);
}

}  // namespace

absl::Status CheckArrays(const VoxelizeResult& result, const JobContext* job) {
  if (result.targets.size() != result.specs.size()) return Malformed("target0");
  const uint64_t bricks = result.listed_bricks();
  if (result.kind == ResultKind::kSparse) {
    uint64_t limit = 1;
    for (const int64_t dim : result.grid.dims) limit *= (uint64_t(dim) + kBrick - 1) / kBrick;
    if (absl::Status s = CheckAscends(Words(result.bricks), limit, "brick", job); !s.ok()) return s;
    if (result.masks.size() != bricks * kMaskWords * sizeof(uint64_t)) return Malformed("mask");
  } else if (result.kind == ResultKind::kBuckets) {
    absl::Status s = CheckAscends(Words(result.voxels), result.grid.voxels(), "voxel", job);
    if (!s.ok()) return s;
    const std::span<const uint64_t> offsets = Words(result.offsets);
    const bool ends = offsets.size() == result.listed_voxels() + 1 && offsets.front() == 0 &&
                      offsets.back() == result.listed_fragments();
    // A listed voxel has at least one fragment.
    if (!ends) return Malformed("offset");
    s = CheckAscends(offsets, offsets.back() + 1, "offset", job);
    if (!s.ok()) return s;
  }
  const ResultHeader header = HeaderOf(result);
  const std::vector<std::span<const uint8_t>> arrays = ArraysOf(result);
  for (size_t i = 0; i < arrays.size(); ++i) {
    if (arrays[i].size() != header.arrays[i].bytes()) return Malformed(header.arrays[i].name);
  }
  return absl::OkStatus();
}

uint64_t PreviewItems::MemoryBytes(const VoxelizeResult& result) {
  return result.kind == ResultKind::kSparse ? result.listed_bricks() * sizeof(uint64_t) : 0;
}

PreviewItems::PreviewItems(const VoxelizeResult& result) : result_(result) {
  count_ = result.kind == ResultKind::kBuckets ? result.listed_fragments() : result.listed_voxels();
  if (result.kind != ResultKind::kSparse) return;
  const std::span<const uint64_t> masks = Words(result.masks);
  before_.reserve(result.listed_bricks());
  uint64_t sum = 0;
  for (size_t i = 0; i < masks.size(); ++i) {
    if (i % kMaskWords == 0) before_.push_back(sum);
    sum += uint64_t(std::popcount(masks[i]));
  }
}

uint64_t PreviewItems::PlaceOf(uint64_t n) const {
  const std::span<const uint64_t> voxels = Words(result_.voxels);
  const auto found = std::lower_bound(voxels.begin(), voxels.end(), n);
  return found == voxels.end() || *found != n ? kNone : uint64_t(found - voxels.begin());
}

uint64_t PreviewItems::FragmentsOf(uint64_t n) const {
  const uint64_t place = PlaceOf(n);
  const std::span<const uint64_t> offsets = Words(result_.offsets);
  return place == kNone ? 0 : offsets[place + 1] - offsets[place];
}

uint64_t PreviewItems::MaxFragments() const {
  const std::span<const uint64_t> offsets = Words(result_.offsets);
  uint64_t most = 0;
  for (size_t i = 1; i < offsets.size(); ++i) most = std::max(most, offsets[i] - offsets[i - 1]);
  return most;
}

uint64_t PreviewItems::Find(uint64_t n) const {
  if (result_.kind == ResultKind::kDense) return n;
  if (result_.kind == ResultKind::kBuckets) {
    const uint64_t place = PlaceOf(n);
    return place == kNone ? kNone : Words(result_.offsets)[place + 1] - 1;
  }
  const auto& dims = result_.grid.dims;
  const uint64_t nx = uint64_t(dims[0]), ny = uint64_t(dims[1]);
  const uint64_t x = n % nx, y = n / nx % ny, z = n / nx / ny;
  const uint64_t bx = (nx + kBrick - 1) / kBrick, by = (ny + kBrick - 1) / kBrick;
  const uint64_t id = x / kBrick + bx * (y / kBrick + by * (z / kBrick));
  const std::span<const uint64_t> bricks = Words(result_.bricks);
  const auto found = std::lower_bound(bricks.begin(), bricks.end(), id);
  if (found == bricks.end() || *found != id) return kNone;
  const auto brick = size_t(found - bricks.begin());
  const std::span<const uint64_t> mask = Words(result_.masks).subspan(brick * kMaskWords, kMaskWords);
  const size_t plane = z % kBrick;
  const uint64_t bit = uint64_t{1} << (x % kBrick + kBrick * (y % kBrick));
  if ((mask[plane] & bit) == 0) return kNone;
  uint64_t rank = before_[brick] + uint64_t(std::popcount(mask[plane] & (bit - 1)));
  for (size_t i = 0; i < plane; ++i) rank += uint64_t(std::popcount(mask[i]));
  return rank;
}

TargetValues::TargetValues(const VoxelizeResult& result, size_t target, uint64_t items)
    : data_(result.targets[target].data()), format_(result.specs[target].format) {
  const auto components = uint64_t(result.specs[target].components);
  item_stride_ = result.layout == Layout::kPlanar ? 1 : components;
  component_stride_ = result.layout == Layout::kPlanar ? items : 1;
}

}  // namespace voxelpipe
