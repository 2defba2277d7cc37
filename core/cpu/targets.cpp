// Allocation and packing of the render targets. FineRaster clears what it does not write.
#include <algorithm>

#include "base/parallel.h"
#include "cpu/a_buffer.h"
#include "cpu/run_state.h"
#include "cpu/sparse.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/part_fill_values.h"
#include "pipeline/stages/target_rules.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cpu {
namespace {

absl::Status Allocate(CpuTarget& target, const RunState& state) {
  const auto bits = [&](BitGrid& grid) -> absl::Status {
    auto created = BitGrid::CreateUncleared(state.slab_dims);
    if (!created.ok()) return created.status();
    grid = *std::move(created);
    return absl::OkStatus();
  };
  if (target.own_presence) {
    if (absl::Status s = bits(target.presence); !s.ok()) return s;
  }
  if (state.request.request.result == ResultKind::kSparse) return absl::OkStatus();  // tiles keep the values
  if (target.spec.format == VoxelFormat::kBit) return target.is_occupancy ? absl::OkStatus() : bits(target.bits);
  auto dense = HostBuffer::Allocate(TargetBytes(target.spec, state.slab_voxels()));
  if (!dense.ok()) return dense.status();
  target.dense = *std::move(dense);
  return absl::OkStatus();
}

// True if the shader may discard fragments of some of the mesh's materials.
bool MayDiscardAny(const MeshView& mesh, FragmentShaderId shader) {
  return std::any_of(mesh.parts, mesh.parts + mesh.part_count,
                     [&](const PartView& part) { return MayDiscard(shader, mesh.materials[part.material]); });
}

// Once a run.
absl::Status MakePartFills(RunState& state) {
  if (state.part_fills) return absl::OkStatus();
  state.part_fills_memory = MemoryCharge(&MemoryOf(state.job));
  state.part_fills.emplace(state.request.request.targets.size());
  const std::vector<RigidMotionNumbers> motions = MotionsByRank(state.mesh, state.request);
  for (size_t i = 0; i < state.part_fills->size(); ++i) {
    if (!FillsByPart(state.request, i)) continue;
    const uint64_t bytes = state.request.parts->parts.size() * sizeof(FillValue);
    absl::Status full = state.part_fills_memory.Grow(bytes, "the values inside of parts");
    if (!full.ok()) return full;
    (*state.part_fills)[i] = PartFillValues(state.request, i, state.view, motions, state.grid);
  }
  return absl::OkStatus();
}

constexpr int64_t kPackBytes = 256 << 10;  // between two checks of the job

absl::Status PackBitTarget(const RunState& state, const CpuTarget& target, HostBuffer& out) {
  const BitGrid& present = target.own_presence ? target.presence : state.coverage;
  const BitGrid& value = target.is_occupancy ? present : target.bits;
  const uint32_t clear = target.spec.clear != 0 ? ~0u : 0, fill = FillBit(target.spec) ? ~0u : 0;
  const int64_t words = state.coverage.words_per_row(), last_word = words - 1;
  const uint32_t last_mask = state.coverage.last_word_mask();
  // Eight rows of any length end on a byte border, so parts of the grid are packed like small grids.
  const int64_t nx = state.slab_dims[0], rows = state.slab_dims[1] * state.slab_dims[2];
  const int64_t part = std::max<int64_t>(8, kPackBytes * 8 / nx / 8 * 8);
  return ParallelChunks((rows + part - 1) / part, 1, state.job, [&](int64_t begin, int64_t end) {
    const int64_t first = begin * part, count = std::min(rows, end * part) - first;
    // By value: references would be read again for every word, because the written bytes may alias them.
    const uint32_t* const here_words = present.row(first).data();
    const uint32_t* const value_words = value.row(first).data();
    const uint32_t* const inside_words = state.inside.empty() ? nullptr : state.inside.row(first).data();
    const auto word_at = [=](int64_t row, int64_t w) {
      const int64_t at = row * words + w;
      const uint32_t here = here_words[at];
      const uint32_t inside = inside_words == nullptr ? 0 : inside_words[at];
      const uint32_t elsewhere = (inside & fill) | (~inside & clear);
      const uint32_t word = (here & value_words[at]) | (~here & elsewhere);
      return w == last_word ? word & last_mask : word;
    };
    PackBits({nx, count, 1}, out.bytes().subspan(size_t(first * nx / 8)), word_at);
  });
}

}  // namespace

bool PlainBits(const HostMesh& mesh, const GridSpec& grid) {
  const VoxelizeRequest& request = mesh.request.request;
  if (request.result == ResultKind::kBuckets || !RowBitsFit(grid, mesh.view.triangle_count)) return false;
  for (size_t i = 0; i < request.targets.size(); ++i) {
    if (request.targets[i].format != VoxelFormat::kBit) return false;
    if (FragmentShaderId(mesh.request.fragment_shaders[i].id) != FragmentShaderId::kOccupancy) return false;
    if (HoldsOwner(request, request.targets[i]) && !FillBit(request.targets[i])) return false;
  }
  return true;
}

absl::Status BeginSlab(RunState& state, const Slab& slab) {
  if (absl::Status s = MakePartFills(state); !s.ok()) return s;
  state.slab = slab;
  state.slab_dims = {state.dims[0], state.dims[1], slab.depth()};
  state.targets.clear();
  state.inside = BitGrid();
  state.coverage = BitGrid();  // to the pool, before the next one is taken from there
  state.counts = SlabCounts();
  state.tile_values.clear();
  state.slab_tiles.clear();
  state.value_arenas.clear();
  state.kept_bytes = 0;
  state.a_buffer.reset();
  state.by_parts = FillsParts(state.request.request);
  // Where parts cover voxels, those that they own are counted.
  state.needs_ranks = state.by_parts && state.request.request.coverage != Coverage::kNone;
  state.counts.part_odd_columns.assign(state.part_count(), 0);
  state.counts.part_voxels.assign(state.part_count(), 0);
  state.inside_ranks = HostArray<uint16_t>();
  const bool buckets = state.request.request.result == ResultKind::kBuckets;
  if (!buckets) {
    auto coverage = BitGrid::CreateUncleared(state.slab_dims);
    if (!coverage.ok()) return coverage.status();
    state.coverage = *std::move(coverage);
  }
  for (size_t i = 0; i < state.request.request.targets.size(); ++i) {
    const BoundShader& shader = state.request.fragment_shaders[i];
    CpuTarget target;
    target.spec = state.request.request.targets[i];
    target.shader = FragmentShaderId(shader.id);
    target.params = shader.params;
    target.u32_output = shader.info->output_type == "u32";
    const VoxelFormat format = target.spec.format;
    target.kept_format = KeptFormat(target.spec);
    target.scale = ScaleOf(target.spec, shader);
    target.clear_stored = StoredBits(NumberToCell(target.spec.clear, format), format);
    target.fill = FillValueOf(state.request, i, state.grid);
    target.is_occupancy = target.spec.format == VoxelFormat::kBit && target.shader == FragmentShaderId::kOccupancy;
    target.of_owner = HoldsOwner(state.request.request, target.spec) && !(target.is_occupancy && FillBit(target.spec));
    if (target.of_owner) target.is_occupancy = false;  // the owner may have no fragment where others have
    target.own_presence = MayDiscardAny(state.view, target.shader) || target.of_owner;
    target.ids_unordered = state.by_parts;
    target.part_fills = (*state.part_fills)[i];
    state.needs_ranks = state.needs_ranks || target.of_owner || !target.part_fills.empty();
    if (!buckets) {
      if (absl::Status s = Allocate(target, state); !s.ok()) return s;
    }
    state.targets.push_back(std::move(target));
  }
  return absl::OkStatus();
}

absl::StatusOr<ResultArrays> Finish(RunState& state) {
  // The input of the lists is freed before the slabs are joined, which takes memory for all of them.
  if (state.request.request.result == ResultKind::kSparse) {
    absl::StatusOr<ResultArrays> bricks = MakeBricks(state);
    state.tile_values = {};
    state.value_arenas.clear();
    return bricks;
  }
  if (state.request.request.result == ResultKind::kBuckets) {
    ResultArrays arrays = std::move(state.a_buffer->arrays);
    state.a_buffer->tiles = {};
    state.a_buffer->arenas.clear();
    return arrays;
  }
  ResultArrays results;
  for (CpuTarget& target : state.targets) {
    if (target.spec.format != VoxelFormat::kBit) {
      results.targets.push_back(std::move(target.dense));
      continue;
    }
    const bool as_it_is =
        target.is_occupancy && state.inside.empty() && target.spec.clear == 0 && state.dims[0] % 32 == 0;
    if (as_it_is && &target == &state.targets.back()) {
      results.targets.push_back(state.coverage.TakePacked());
      continue;
    }
    auto packed = HostBuffer::Allocate(TargetBytes(target.spec, state.slab_voxels()));
    if (!packed.ok()) return packed.status();
    if (absl::Status s = PackBitTarget(state, target, *packed); !s.ok()) return s;
    results.targets.push_back(*std::move(packed));
  }
  return results;
}

}  // namespace voxelpipe::cpu
