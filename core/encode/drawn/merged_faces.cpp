#include "encode/drawn/merged_faces.h"

#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "absl/container/flat_hash_map.h"

namespace voxelpipe {
namespace {

// What the rectangles found so far take, and the error that ended the search.
struct MergeState {
  ChargedGrowth growth;
  std::vector<MergedFace> made;
  absl::Status status;
};

// The rectangles of one side. Faces come in the order of VisitFaces: a row runs along x, or on the sides -x and +x
// along y, and rows follow each other along z, or on the sides -z and +z along y.
class SideFaces {
 public:
  SideFaces(int side, MergeState& state, MemoryBudget& budget)
      : side_(side),
        along_(side / 2 == 0 ? 1 : 0),
        across_(side / 2 == 2 ? 1 : 2),
        line_axis_(side / 2 == 0 ? 0 : 1),
        state_(state),
        made_(state.made),
        run_growth_(budget, kRunBytes, "open faces:"),
        table_growth_(budget, 2 * TableEntryBytes(sizeof(Key) + sizeof(size_t)), "open faces:") {}

  void Add(const std::array<int64_t, 3>& voxel, uint64_t colour) {
    if (state_.status.ok()) state_.status = run_growth_.Reach(runs_.size() + 1);
    if (!state_.status.ok()) return;
    const int64_t line = voxel[line_axis_];
    // Only on the sides -x and +x do faces of a line come between those of others.
    if (line_axis_ == 1 && !runs_.empty() && runs_.begin()->first != line) CloseRuns();
    const auto [entry, added] = runs_.try_emplace(line, MergedFace{voxel, voxel, colour, side_});
    if (added) return;
    MergedFace& run = entry->second;
    if (run.high[along_] + 1 == voxel[along_] && run.colour == colour) {
      run.high = voxel;
      return;
    }
    CloseRun(run);
    run = {voxel, voxel, colour, side_};
  }

  // Call after the last face of a layer.
  void EndLayer() {
    CloseRuns();
    open_.swap(next_);
    next_.clear();
    if (across_ == 1) open_.clear();  // the next layer is another plane
  }

 private:
  // Plane, first and last voxel of a row, and colour of a rectangle that the next row may extend.
  using Key = std::tuple<int64_t, int64_t, int64_t, uint64_t>;

  void CloseRuns() {
    for (const auto& [line, run] : runs_) CloseRun(run);
    runs_.clear();
  }

  void CloseRun(const MergedFace& run) {
    const Key key{run.low[size_t(side_ / 2)], run.low[along_], run.high[along_], run.colour};
    // Rows of a layer's own plane follow each other within the layer, the others from layer to layer.
    auto& before = across_ == 1 ? next_ : open_;
    const auto found = before.find(key);
    if (state_.status.ok()) state_.status = state_.growth.Reach(made_.size() + 1, made_);
    if (state_.status.ok()) state_.status = table_growth_.Reach(next_.size() + 1);
    if (!state_.status.ok()) return;
    size_t place = made_.size();
    if (found != before.end() && made_[found->second].high[across_] + 1 == run.low[across_]) {
      place = found->second;
      made_[place].high = run.high;
    } else {
      made_.push_back(run);
    }
    next_.insert_or_assign(key, place);
  }

  int side_;
  size_t along_, across_, line_axis_;
  static constexpr uint64_t kRunBytes = sizeof(MergedFace) + 64;  // with what a node of a map has besides

  MergeState& state_;
  std::vector<MergedFace>& made_;
  ChargedGrowth run_growth_, table_growth_;
  std::map<int64_t, MergedFace> runs_;            // by line; ordered, so that the result is the same each time
  absl::flat_hash_map<Key, size_t> open_, next_;  // rectangles of the layer before, and of this one
};

}  // namespace

absl::StatusOr<std::vector<MergedFace>> MergeFaces(const PreviewVolume& volume,
                                                   const std::function<uint64_t(uint64_t n)>& colour_of,
                                                   const JobContext* job, MemoryCharge& memory) {
  MemoryBudget& budget = MemoryOf(job);
  MergeState state{ChargedGrowth(budget, sizeof(MergedFace), "merged faces:"), {}, {}};
  std::vector<SideFaces> sides;
  for (int side = 0; side < kSides; ++side) sides.emplace_back(side, state, budget);
  std::optional<std::pair<uint64_t, uint64_t>> last;  // a voxel and its colour: its faces come one after the other
  if (absl::Status s = CheckJob(job); !s.ok()) return s;
  JobPoll poll(job);
  for (int64_t layer = 0; layer < volume.layers(); ++layer) {
    const int64_t k = volume.Layer(layer);
    const absl::Status s = VisitFaces(volume, k, poll, [&](int64_t i, int64_t j, uint64_t n, int side) {
      if (!last || last->first != n) last.emplace(n, colour_of(n));
      sides[size_t(side)].Add({i, j, k}, last->second);
    });
    if (!s.ok()) return s;
    for (SideFaces& side : sides) side.EndLayer();
    if (!state.status.ok()) return state.status;
  }
  memory.Absorb(state.growth.TakeCharge());
  return std::move(state.made);
}

}  // namespace voxelpipe
