// binvox: a cube of bits in runs.
//
// Source: P. Min, "Binvox voxel file format specification", 2004 to 2019. y is the fastest axis, then z, then x;
// `scale` is the edge of the whole cube, `translate` its corner of the smallest coordinates.
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/drawn/whole_file.h"
#include "encode/formats/bytes.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

constexpr size_t kPieceBytes = 1 << 20;
constexpr uint64_t kMaxRun = 255;

// The data of the file: a value and a count, up to 255, for each run.
class RunWriter {
 public:
  RunWriter(AtomicFile& file, const JobContext* job) : file_(file), job_(job) {}

  // The next `count` voxels. The file's or the job's error.
  absl::Status Add(bool solid, uint64_t count) {
    if (solid != value_) {
      if (absl::Status s = PutRun(); !s.ok()) return s;
    }
    value_ = solid;
    run_ += count;
    return absl::OkStatus();
  }
  absl::Status Finish() {
    absl::Status s = PutRun();
    return s.ok() ? Flush() : s;
  }

 private:
  absl::Status PutRun() {
    for (; run_ > 0; run_ -= std::min(run_, kMaxRun)) {
      bytes_.Put(uint8_t(value_)).Put(uint8_t(std::min(run_, kMaxRun)));
      if (bytes_.size() < kPieceBytes) continue;
      if (absl::Status s = Flush(); !s.ok()) return s;
    }
    return absl::OkStatus();
  }
  absl::Status Flush() {
    absl::Status s = file_.Write(bytes_.span(), job_);
    bytes_.clear();
    return s;
  }

  AtomicFile& file_;
  const JobContext* job_;
  Bytes bytes_;
  bool value_ = false;
  uint64_t run_ = 0;
};

absl::Status AddEachVoxel(const PreviewVolume& volume, int64_t side, const JobContext* job, RunWriter& runs) {
  const auto [nx, ny, nz] = volume.dims();
  JobPoll poll(job);
  for (int64_t x = 0; x < side; ++x) {
    for (int64_t z = 0; z < side; ++z) {
      const bool inside = x < nx && z < nz;
      absl::Status s = poll.Add(inside ? uint64_t(ny) / 8 + 1 : 1);
      for (int64_t y = 0; inside && y < ny && s.ok(); ++y) s = runs.Add(volume.Solid(x, y, z), 1);
      if (s.ok()) s = runs.Add(false, uint64_t(inside ? side - ny : side));
      if (!s.ok()) return s;
    }
  }
  return absl::OkStatus();
}

// The same from the bricks of the volume alone: what lies between their voxels is counted, not looked at.
absl::Status AddBricks(const PreviewVolume& volume, int64_t side, const JobContext* job, RunWriter& runs,
                       MemoryCharge& memory) {
  using Brick = std::array<int32_t, 3>;  // x, z, y: in the order of the file
  uint64_t count = 0;
  absl::Status s = volume.VisitBricks(job, [&](int64_t, int64_t, int64_t) { ++count; });
  if (s.ok()) s = memory.Grow(count, sizeof(Brick), "bricks:");
  if (!s.ok()) return s;
  std::vector<Brick> bricks;
  bricks.reserve(count);
  s = volume.VisitBricks(job, [&](int64_t x, int64_t y, int64_t z) {
    bricks.push_back({int32_t(x), int32_t(z), int32_t(y)});
  });
  if (!s.ok()) return s;
  tbb::parallel_sort(bricks.begin(), bricks.end());
  const auto [nx, ny, nz] = volume.dims();
  const auto cube = uint64_t(side);
  uint64_t end = 0;  // of what has been added
  JobPoll poll(job);
  // A column of bricks along y gives eight by eight rows of the file, all columns of one x one after the other.
  const auto column_end = [&](size_t begin, size_t axes) {
    size_t last = begin;
    while (last < bricks.size() &&
           std::equal(bricks[begin].begin(), bricks[begin].begin() + ptrdiff_t(axes), bricks[last].begin())) {
      ++last;
    }
    return last;
  };
  for (size_t first = 0, last = 0; first < bricks.size(); first = last) {
    last = column_end(first, 1);
    for (int64_t x = 8 * int64_t(bricks[first][0]); x < std::min<int64_t>(nx, 8 * int64_t(bricks[first][0]) + 8); ++x) {
      for (size_t begin = first, next = first; begin < last; begin = next) {
        next = column_end(begin, 2);
        const int64_t low = 8 * int64_t(bricks[begin][1]);
        for (int64_t z = low; z < std::min<int64_t>(nz, low + 8); ++z) {
          if (s = poll.Add(next - begin); !s.ok()) return s;
          for (size_t b = begin; b < next; ++b) {
            const uint64_t word = volume.FindBrick(bricks[b][0], bricks[b][2], bricks[b][1])[z % 8] >> (x % 8);
            for (int64_t y = 8 * int64_t(bricks[b][2]); y < std::min<int64_t>(ny, 8 * int64_t(bricks[b][2]) + 8); ++y) {
              if ((word >> (8 * (y % 8)) & 1) == 0) continue;
              const uint64_t at = (uint64_t(x) * cube + uint64_t(z)) * cube + uint64_t(y);
              if (at > end) s = runs.Add(false, at - end);
              if (s.ok()) s = runs.Add(true, 1);
              if (!s.ok()) return s;
              end = at + 1;
            }
          }
        }
      }
    }
  }
  return end < cube * cube * cube ? runs.Add(false, cube * cube * cube - end) : absl::OkStatus();
}

absl::Status EncodeBinvox(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  const GridSpec& grid = drawn.result.grid;
  const int64_t side = *std::max_element(grid.dims.begin(), grid.dims.end());  // readers want cubes
  if (absl::Status s = drawn.memory.Grow(2 * kPieceBytes, "runs:"); !s.ok()) return s;
  Bytes head;
  head.Text(absl::StrCat("#binvox 1\ndim ", side, " ", side, " ", side, "\ntranslate ", Shortest(grid.origin.x), " ",
                         Shortest(grid.origin.y), " ", Shortest(grid.origin.z), "\nscale ",
                         Shortest(double(side) * grid.voxel_size.x), "\ndata\n"));
  absl::Status s = file.Write(head.span(), job);
  if (!s.ok()) return s;
  RunWriter runs(file, job);
  s = drawn.volume.in_bricks() ? AddBricks(drawn.volume, side, job, runs, drawn.memory)
                               : AddEachVoxel(drawn.volume, side, job, runs);
  return s.ok() ? runs.Finish() : s;
}

}  // namespace

std::unique_ptr<ResultFile> MakeBinvoxFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".binvox", path, job, &EncodeBinvox);
}

}  // namespace voxelpipe
