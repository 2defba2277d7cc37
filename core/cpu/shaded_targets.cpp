#include "cpu/shaded_targets.h"

#include <algorithm>
#include <bit>

#include "shaders/interface/fragment_input.h"

namespace voxelpipe::cpu {
namespace {

Wanted WantedBy(const CpuTarget& target) {
  if (!TraitsOf(target.shader).needs_plane) return Wanted::kAll;  // cheaper shaded than left out
  if (target.spec.blend == Blend::kReplace) return Wanted::kLast;
  return target.spec.blend == Blend::kFirst && !target.ids_unordered ? Wanted::kFirst : Wanted::kAll;
}

}  // namespace

ShadedTargets::ShadedTargets(const RunState& state, Wanted wanted, std::vector<TileBuffer>& buffers)
    : state_(state), winners_(wanted != Wanted::kAll), buffers_(buffers), part_(state.view) {
  shaders_.resize(state.targets.size());
  for (size_t t = 0; t < state.targets.size(); ++t) {
    const CpuTarget& target = state.targets[t];
    if (target.is_occupancy || WantedBy(target) != wanted) continue;
    targets_ |= 1u << t;
    traits_ |= TraitsOf(target.shader);
    shaders_[t].emplace(*state.shade_kernels, target.shader, target.params);
  }
  batch_.mesh = &state.view;
}

void ShadedTargets::BeginTile(const int64_t (&origin)[3]) {
  for (int a = 0; a < 3; ++a) batch_.origin[a] = int32_t(origin[a]);
  taken_.fill(0);
}

void ShadedTargets::Add(uint32_t triangle, std::span<const TileSpan> spans) {
  if (!part_.IsIn(triangle)) {
    Flush();
    EnterPartOf(triangle);
  }
  if (same_ != 0) BlendSame(triangle, spans);
  if (varying_ == 0 && !winners_) return;
  bool added = varying_ == 0;
  for (const TileSpan span : spans) {
    const size_t row = size_t(span.row());
    uint32_t mask = span.mask();
    if (winners_) {
      mask &= ~taken_[row];
      if (!may_discard_) taken_[row] |= mask;
    }
    if (varying_ == 0) continue;
    for (; mask != 0; mask &= mask - 1) {
      if (batch_.full()) {
        Flush();
        added = false;
      }
      if (!added) batch_.AddTriangle(triangle);
      added = true;
      batch_.AddFragment(row * 32 + size_t(std::countr_zero(mask)));
    }
  }
}

void ShadedTargets::Flush() {
  if (batch_.count > 0) {
    batch_.Complete();
    if (traits_.needs_plane) state_.shade_kernels->place(batch_);
    for (uint32_t left = varying_; left != 0; left &= left - 1) {
      const auto t = size_t(std::countr_zero(left));
      shaders_[t]->Shade(batch_, shaded_);
      buffers_[t].BlendBatch(*state_.shade_kernels, batch_, shaded_, winners_);
    }
    if (winners_ && may_discard_) FindTaken();
  }
  batch_.Clear();
}

void ShadedTargets::EnterPartOf(uint32_t triangle) {
  part_.MoveTo(triangle);
  batch_.part = &part_.part();
  const FragmentInput in = MakePlainInput(state_.view, triangle);
  same_ = varying_ = 0;
  may_discard_ = false;
  for (uint32_t left = targets_; left != 0; left &= left - 1) {
    const int t = std::countr_zero(left);
    const FragmentShaderId shader = state_.targets[size_t(t)].shader;
    (SameForTriangle(shader, in) ? same_ : varying_) |= 1u << t;
    may_discard_ = may_discard_ || MayDiscard(shader, in.material());
  }
}

void ShadedTargets::BlendSame(uint32_t triangle, std::span<const TileSpan> spans) {
  if (winners_ && std::all_of(spans.begin(), spans.end(),
                              [&](TileSpan span) { return (span.mask() & ~taken_[size_t(span.row())]) == 0; })) {
    return;
  }
  const FragmentInput in = InputOf(triangle);
  for (uint32_t left = same_; left != 0; left &= left - 1) {
    const auto t = size_t(std::countr_zero(left));
    const CpuTarget& target = state_.targets[t];
    FragmentOutput out;
    ShadeFragment(target.shader, in, target.params, out);
    if (out.discard) continue;
    TileBuffer& buffer = buffers_[t];
    const BlendValue value = buffer.Convert(out);
    for (const TileSpan span : spans) {
      if (winners_) {
        buffer.BlendUntaken(span.row(), span.mask(), value, in.part->rank);
      } else {
        buffer.Blend(span, value, in.triangle, in.part->rank);
      }
    }
  }
}

FragmentInput ShadedTargets::InputOf(uint32_t triangle) const {
  if (!traits_.needs_plane) return MakePlainInput(state_.view, triangle);
  const uint32_t* v = state_.view.triangles[triangle];
  const Vec3d* p = state_.index_positions;
  return MakeFragmentInput(state_.view, triangle, SetUpPlane(p[v[0]], p[v[1]], p[v[2]]).degenerate, false);
}

void ShadedTargets::FindTaken() {
  for (size_t row = 0; row < taken_.size(); ++row) {
    uint32_t all = ~0u;
    for (uint32_t left = targets_; left != 0; left &= left - 1) {
      all &= buffers_[size_t(std::countr_zero(left))].presence(int(row));
    }
    taken_[row] = all;
  }
}

}  // namespace voxelpipe::cpu
