#include "encode/drawn/merged_faces.h"

#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "absl/container/flat_hash_map.h"

namespace voxelpipe {
namespace {

// The rectangles of one side. Faces come in the order of VisitFaces: a row runs along x, or on the sides -x and +x
// along y, and rows follow each other along z, or on the sides -z and +z along y.
class SideFaces {
 public:
  SideFaces(int side, std::vector<MergedFace>& made)
      : side_(side),
        along_(side / 2 == 0 ? 1 : 0),
        across_(side / 2 == 2 ? 1 : 2),
        line_axis_(side / 2 == 0 ? 0 : 1),
        made_(made) {}

  void Add(const std::array<int64_t, 3>& voxel, uint64_t colour) {
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
  std::vector<MergedFace>& made_;
  std::map<int64_t, MergedFace> runs_;            // by line; ordered, so that the result is the same each time
  absl::flat_hash_map<Key, size_t> open_, next_;  // rectangles of the layer before, and of this one
};

}  // namespace

absl::StatusOr<std::vector<MergedFace>> MergeFaces(const PreviewVolume& volume,
                                                   const std::function<uint64_t(uint64_t n)>& colour_of,
                                                   const JobContext* job) {
  std::vector<MergedFace> made;
  std::vector<SideFaces> sides;
  for (int side = 0; side < kSides; ++side) sides.emplace_back(side, made);
  std::optional<std::pair<uint64_t, uint64_t>> last;  // a voxel and its colour: its faces come one after the other
  for (int64_t k = 0; k < volume.dims()[2]; ++k) {
    if (job != nullptr) {
      if (absl::Status s = job->Check(); !s.ok()) return s;
    }
    VisitFaces(volume, k, [&](int64_t i, int64_t j, uint64_t n, int side) {
      if (!last || last->first != n) last.emplace(n, colour_of(n));
      sides[size_t(side)].Add({i, j, k}, last->second);
    });
    for (SideFaces& side : sides) side.EndLayer();
  }
  return made;
}

}  // namespace voxelpipe
