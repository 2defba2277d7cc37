// Runs one pass of a batch: describes its members, allocates, uploads, launches all steps, and extracts results.
#include "cuda/batch/batch_pass.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "cuda/batch/batch_bricks.h"
#include "cuda/device/device_layout.h"
#include "cuda/run/run_state.h"
#include "pipeline/stages/target_rules.h"

namespace voxelpipe::cuda {

BatchPass::BatchPass(const DeviceInfo& device, DeviceUse use, std::span<const std::unique_ptr<BatchMember>> members)
    : members_(members), use_(std::move(use)), kept_(device.ordinal, use_.stream()) {
  state_.device = device;
  state_.stream = use_.stream();
}

BatchPass::~BatchPass() {
  use_.Wait();  // before the memory that its work uses is released
}

absl::Status BatchPass::Run() {
  Describe();
  VOXELPIPE_OK_OR_RETURN(Allocate());
  VOXELPIPE_OK_OR_RETURN(Upload());
  VOXELPIPE_OK_OR_RETURN(RasterBatch(state_));
  VOXELPIPE_OK_OR_RETURN(ClearBatch(state_));
  VOXELPIPE_OK_OR_RETURN(valued_.Make(state_));
  VOXELPIPE_OK_OR_RETURN(FloodBatch(state_));
  VOXELPIPE_OK_OR_RETURN(FillBatch(state_));
  VOXELPIPE_OK_OR_RETURN(PackBatch(state_));
  VOXELPIPE_OK_OR_RETURN(buckets_.Make(state_));
  const uint64_t back_bytes = buckets_at_ + buckets_.result_bytes();
  absl::StatusOr<PinnedBuffer> back = PinnedBuffer::Take(back_bytes + 8);  // bricks are read 8 bytes past the end
  if (!back.ok()) return back.status();
  back_ = *std::move(back);
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(back_.data(), state_.view.counts, result_bytes_, cudaMemcpyDeviceToHost, state_.stream));
  VOXELPIPE_OK_OR_RETURN(buckets_.CopyBack(state_, back_.data() + buckets_at_));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(state_.stream));
  return absl::OkStatus();
}

BatchCounts BatchPass::CountsOf(size_t number) const {
  BatchCounts counts;
  std::memcpy(&counts, back_.data() + number * sizeof counts, sizeof counts);
  return counts;
}

absl::StatusOr<VoxelizeResult> BatchPass::Cut(size_t number) {
  BatchMember& member = *members_[number];
  VOXELPIPE_OK_OR_RETURN(member.item->job->Check());
  VoxelizeResult result;
  result.kind = member.request().result;
  result.grid = member.plan.grid;
  result.layout = member.request().layout;
  result.specs = member.request().targets;
  BatchCounts counts = CountsOf(number);
  if (member.path == BatchPath::kFragments) {
    VOXELPIPE_OK_OR_RETURN(buckets_.Cut(number - state_.first_bucketed, back_.data() + buckets_at_, result));
    counts.occupied = result.listed_voxels();
    counts.fragments = result.listed_fragments();
  } else {
    VOXELPIPE_OK_OR_RETURN(CutGrid(member, places_[number], result));
  }
  result.stats = std::move(member.stats);
  result.stats.triangles = member.triangles();
  result.stats.occupied = counts.occupied;
  if (member.parity()) result.stats.odd_columns = counts.odd_columns;
  if (member.path != BatchPath::kRows) result.stats.fragments = counts.fragments;
  result.stats.backend = result.stats.simd = "cuda";
  const char* const path = member.path == BatchPath::kRows     ? "batch: occupancy"
                           : member.path == BatchPath::kValues ? "batch: fragments in accumulators"
                                                               : "batch: fragment list";
  result.stats.path.assign(result.specs.size(), path);
  return result;
}

absl::Status BatchPass::CutGrid(const BatchMember& member, const Place& place, VoxelizeResult& result) const {
  const uint8_t* const packed = back_.data() + packed_offset_;
  uint32_t next_packed = place.first_packed;
  const auto take_packed = [&] { return packed + packed_[next_packed++].first_packed * sizeof(uint32_t); };
  if (member.sparse() && member.path == BatchPath::kRows) {
    const uint8_t* const occupied = take_packed();
    const uint8_t* const covered = member.filled() ? take_packed() : nullptr;
    return BricksOfBits(occupied, covered, result);
  }
  const uint8_t* const occupied = member.sparse() ? take_packed() : nullptr;
  std::vector<const uint8_t*> dense;
  for (size_t t = 0; t < result.specs.size(); ++t) {
    const bool bits = result.specs[t].format == VoxelFormat::kBit;
    dense.push_back(bits ? take_packed() : back_.data() + values_offset_ + place.values->values[t]);
  }
  if (member.sparse()) return BricksOfDense(occupied, dense, result);
  for (size_t t = 0; t < dense.size(); ++t) {
    absl::StatusOr<HostBuffer> target = HostBuffer::Allocate(TargetBytes(result.specs[t], result.grid.voxels()));
    if (!target.ok()) return target.status();
    std::memcpy(target->data(), dense[t], target->size());
    result.targets.push_back(*std::move(target));
  }
  return absl::OkStatus();
}

void BatchPass::Describe() {
  items_.reserve(members_.size());
  packed_.reserve(members_.size());
  places_.reserve(members_.size());
  for (const auto& member : members_) {
    DescribeItem(*member);
    DescribeTargets(*member);
  }
  BatchView& view = state_.view;
  view.item_count = uint32_t(items_.size());
  view.target_count = uint32_t(packed_.size());
  view.value_count = uint32_t(values_.size());
}

void BatchPass::DescribeItem(const BatchMember& member) {
  BatchView& view = state_.view;
  const GridSpec& grid = member.plan.grid;
  const bool grids = member.path != BatchPath::kFragments;
  BatchItemView item;
  for (int a = 0; a < 3; ++a) item.grid.dims[a] = grid.dims[size_t(a)];
  item.grid.slab_end = item.grid.dims[2];
  item.grid.words_per_row = (item.grid.dims[0] + 31) / 32;
  item.grid.space = grid.index_space();
  item.coverage = member.request().coverage;
  item.parity = member.parity();
  item.flood = member.flood();
  item.own_shell = member.own_shell();
  const int64_t* const d = item.grid.dims;
  item.look_first = member.triangles() > 16 * uint64_t(d[0] * d[1] + d[1] * d[2] + d[2] * d[0]);
  item.first_vertex = view.vertex_count;
  item.first_triangle = view.triangle_count;
  item.first_row = view.row_count;
  item.first_word = words_;
  item.first_column = columns_;
  item.first_shell = shell_words_;
  item.first_touched = words_;
  item.triangle_count = member.triangles();
  item.words = grids ? member.words() : 0;
  item.column_words = item.parity ? (item.grid.dims[1] + 31) / 32 : 0;
  view.vertex_count += member.vertices();
  view.triangle_count += member.triangles();
  if (member.path == BatchPath::kRows) view.row_triangles += member.triangles();
  if (member.path == BatchPath::kValues) {
    view.value_triangles += member.triangles();
    item.first_voxel = view.voxel_count;
    view.voxel_count += member.plan.grid.voxels();
  }
  if (grids) view.row_count += member.rows();
  view.any_parity = view.any_parity || item.parity;
  if (item.flood && view.flood_count++ == 0) view.first_flood = uint32_t(items_.size());
  if (item.own_shell) {
    if (shell_words_ == 0) view.first_shell_triangle = item.first_triangle;
    view.shell_triangles += member.triangles();
    shell_words_ += item.words;
  }
  words_ += (item.words + 3) / 4 * 4;
  columns_ += member.column_words();
  if (!grids) buckets_.Add(member, uint32_t(items_.size()), item, state_);
  items_.push_back(item);
}

void BatchPass::DescribeTargets(const BatchMember& member) {
  places_.emplace_back().first_packed = uint32_t(packed_.size());
  if (member.path == BatchPath::kFragments) return;
  if (member.sparse()) AddPacked(member, false, true);  // occupied voxels
  if (member.path == BatchPath::kValues) {
    AddValues(member);
  } else if (!member.sparse()) {
    for (const TargetSpec& spec : member.request().targets) AddPacked(member, spec.clear != 0, FillBit(spec));
  } else if (member.filled()) {
    AddPacked(member, false, false);  // covered voxels
  }
}

void BatchPass::AddPacked(const BatchMember& member, bool clear, bool fill) {
  BatchTargetView target;
  target.item = uint32_t(items_.size() - 1);
  target.clear = clear ? ~0u : 0;
  target.fill = fill ? ~0u : 0;
  target.first_packed = state_.view.packed_words;
  target.voxels = member.plan.grid.voxels();
  state_.view.packed_words += member.packed_words();
  packed_.push_back(target);
}

void BatchPass::AddValues(const BatchMember& member) {
  Values& own = *(places_.back().values = std::make_unique<Values>());
  BatchItemView& item = items_.back();
  const std::vector<TargetSpec>& specs = member.request().targets;
  own.first_value = uint32_t(values_.size());
  own.targets.count = int(specs.size());
  own.targets.planar = member.request().layout == voxelpipe::Layout::kPlanar;
  const auto take_grid = [&] {
    const uint64_t at = own_words_;
    own_words_ += (member.words() + 3) / 4 * 4;
    return at;
  };
  for (size_t t = 0; t < specs.size(); ++t) {
    CudaTarget& target = own.targets.at[t] = DescribeTarget(specs[t], member.bound->fragment_shaders[t]);
    own.targets.any_always_present = own.targets.any_always_present || !target.own_presence;
    if (target.own_presence) own.presence[t] = take_grid();
    if (target.format == VoxelFormat::kBit) {
      if (!target.is_occupancy) own.bits[t] = take_grid();
      AddPacked(member, specs[t].clear != 0, FillBit(specs[t]));
      continue;
    }
    BatchValueView values;
    values.item = uint32_t(items_.size() - 1);
    values.components = target.components;
    values.element_bytes = BitsPerComponent(target.format) / 8;
    values.planar = own.targets.planar;
    values.clear_stored = target.clear_stored;
    values.fill = FillValueOf(*member.bound, t, member.plan.grid);
    values.voxels = member.plan.grid.voxels();
    // Whole 16-byte units: all that is copied is cleared.
    values.words = (TargetBytes(specs[t], values.voxels) + 15) / 16 * 4;
    values_.push_back(values);
    own.values[t] = value_bytes_;
    value_bytes_ += values.words * 4;
  }
  own.first_target = uint32_t(valued_.targets());
  valued_.Add(uint32_t(items_.size() - 1), own.targets, item);
  if (!item.shading.drops) return;
  item.first_touched = words_;
  words_ += (item.words + 3) / 4 * 4;
}

absl::Status BatchPass::Allocate() {
  BatchView& view = state_.view;
  BlockLayout layout;
  const uint64_t placed = layout.Add<Vec3d>(view.vertex_count), codes = layout.Add<VertexCode>(view.vertex_count);
  const uint64_t triangles = layout.Add<uint32_t>(3 * view.triangle_count);
  const uint64_t item_of = layout.Add<uint32_t>(view.triangle_count);
  uint64_t queue[3];
  for (uint64_t& q : queue) q = layout.Add<uint32_t>(view.triangle_count);
  const uint64_t queued = layout.Add<uint64_t>(kBatchQueues);  // cleared together from here on
  const uint64_t bits = layout.Add<uint32_t>(words_);
  const uint64_t own_bits = layout.Add<uint32_t>(own_words_);
  const uint64_t shells = layout.Add<uint32_t>(shell_words_);
  const uint64_t inside = layout.Add<uint32_t>(view.any_fill() ? words_ : 0);
  const uint64_t columns = layout.Add<uint32_t>(columns_);
  const uint64_t value_counts = layout.Add<uint32_t>(view.value_triangles + 1);
  const uint64_t bucketed = view.triangle_count - view.row_triangles - view.value_triangles;
  const uint64_t fragment_counts = layout.Add<uint32_t>(bucketed + 1);
  const uint64_t counts = layout.Add<BatchCounts>(view.item_count);  // copied back together from here on
  const uint64_t values = layout.Add<uint8_t>(value_bytes_);         // not cleared from here on
  const uint64_t packed = layout.Add<uint32_t>(view.packed_words);
  const uint64_t word_ranks = layout.Add<uint32_t>(view.value_triangles > 0 ? words_ : 0);
  VOXELPIPE_OK_OR_RETURN(work_.Resize(layout.bytes(), state_.stream));
  view.placed = At<Vec3d>(work_, placed);
  view.codes = At<VertexCode>(work_, codes);
  view.triangles = At<uint32_t>(work_, triangles);
  view.item_of = At<uint32_t>(work_, item_of);
  for (int q = 0; q < 3; ++q) view.queue[q] = At<uint32_t>(work_, queue[q]);
  view.queued = At<uint64_t>(work_, queued);
  view.bits = At<uint32_t>(work_, bits);
  own_bits_ = At<uint32_t>(work_, own_bits);
  view.shells = At<uint32_t>(work_, shells);
  view.inside = At<uint32_t>(work_, inside);
  view.columns = At<uint32_t>(work_, columns);
  view.value_counts = At<uint32_t>(work_, value_counts);
  view.fragment_counts = At<uint32_t>(work_, fragment_counts);
  view.counts = At<BatchCounts>(work_, counts);
  view.packed = At<uint32_t>(work_, packed);
  view.word_ranks = At<uint32_t>(work_, word_ranks);
  first_values_ = At<uint8_t>(work_, values);
  view.zero = At<uint8_t>(work_, queued);
  view.zero_quads = (values - queued) / 16;
  packed_offset_ = packed - counts;
  values_offset_ = values - counts;
  result_bytes_ = packed + view.packed_words * sizeof(uint32_t) - counts;
  buckets_at_ = (result_bytes_ + 255) / 256 * 256;
  return absl::OkStatus();
}

// Sets the device addresses in the descriptions of a member's targets.
void BatchPass::PointAtTargets(size_t number) {
  const BatchMember& member = *members_[number];
  const Values& own = *places_[number].values;
  uint32_t packed = places_[number].first_packed + (member.sparse() ? 1 : 0), value = own.first_value;
  size_t next = own.first_target;
  for (int t = 0; t < own.targets.count; ++t) {
    CudaTarget target = own.targets.at[t];
    if (target.own_presence) target.presence = own_bits_ + own.presence[size_t(t)];
    if (target.format == VoxelFormat::kBit) {
      BatchTargetView& view = packed_[packed++];
      view.present = target.presence;
      view.value = target.presence;
      if (!target.is_occupancy) view.value = target.bits = own_bits_ + own.bits[size_t(t)];
    } else {
      BatchValueView& view = values_[value++];
      view.present = target.presence;
      view.at = target.dense = first_values_ + own.values[size_t(t)];
    }
    if (!target.is_occupancy) valued_.At(next++) = target;
  }
}

absl::Status BatchPass::Upload() {
  BatchView& view = state_.view;
  for (size_t i = 0; i < members_.size(); ++i) {
    if (places_[i].values) PointAtTargets(i);
  }
  UploadLayout layout;
  const uint64_t items = layout.Add(items_.data(), items_.size());
  const uint64_t packed = layout.Add(packed_.data(), packed_.size());
  const uint64_t values = layout.Add(values_.data(), values_.size());
  buckets_.AddTo(layout);
  meshes_.resize(members_.size());
  for (size_t i = 0; i < members_.size(); ++i) {
    VOXELPIPE_OK_OR_RETURN(meshes_[i].Add(*members_[i], kept_, layout));
  }
  absl::StatusOr<PinnedBuffer> staging = PinnedBuffer::Take(layout.bytes());
  if (!staging.ok()) return staging.status();
  staging_ = *std::move(staging);
  VOXELPIPE_OK_OR_RETURN(there_.Resize(layout.bytes(), state_.stream));
  for (size_t i = 0; i < members_.size(); ++i) {
    BatchItemView& item = items_[i];
    meshes_[i].Place(there_.data(), view.placed + item.first_vertex, members_[i]->plan.grid.dims);
    item.positions = meshes_[i].positions();
    item.triangles = meshes_[i].triangles();
    item.shading.mesh = meshes_[i].view();
  }
  layout.CopyTo(staging_.data());
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(there_.data(), staging_.data(), layout.bytes(), cudaMemcpyHostToDevice, state_.stream));
  view.items = At<BatchItemView>(there_, items);
  view.targets = At<BatchTargetView>(there_, packed);
  view.values = At<BatchValueView>(there_, values);
  buckets_.Place(there_.data(), view);
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
