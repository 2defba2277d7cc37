// binvox: a cube of bits in runs.
//
// Source: P. Min, "Binvox voxel file format specification", 2004 to 2019. y is the fastest axis, then z, then x;
// `scale` is the edge of the whole cube, `translate` its corner of the smallest coordinates.
#include <algorithm>

#include "absl/strings/str_cat.h"
#include "encode/drawn/whole_file.h"
#include "encode/formats/bytes.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

constexpr size_t kPieceBytes = 1 << 20;
constexpr uint64_t kMaxRun = 255;

absl::Status EncodeBinvox(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  const GridSpec& grid = drawn.result.grid;
  const int64_t side = *std::max_element(grid.dims.begin(), grid.dims.end());  // readers want cubes
  Bytes bytes;
  bytes.Text(absl::StrCat("#binvox 1\ndim ", side, " ", side, " ", side, "\ntranslate ", Shortest(grid.origin.x), " ",
                          Shortest(grid.origin.y), " ", Shortest(grid.origin.z), "\nscale ",
                          Shortest(double(side) * grid.voxel_size.x), "\ndata\n"));
  bool value = false;
  uint64_t run = 0;
  const auto put_run = [&] {
    for (; run > 0; run -= std::min(run, kMaxRun)) bytes.Put(uint8_t(value)).Put(uint8_t(std::min(run, kMaxRun)));
  };
  const auto add = [&](bool solid, uint64_t count) {
    if (solid != value) put_run();
    value = solid;
    run += count;
  };
  const auto [nx, ny, nz] = grid.dims;
  for (int64_t x = 0; x < side; ++x) {
    for (int64_t z = 0; z < side; ++z) {
      const bool inside = x < nx && z < nz;
      for (int64_t y = 0; inside && y < ny; ++y) add(drawn.volume.Solid(x, y, z), 1);
      add(false, uint64_t(inside ? side - ny : side));
      if (bytes.size() < kPieceBytes) continue;
      if (absl::Status s = file.Write(bytes.span(), job); !s.ok()) return s;
      bytes.clear();
    }
  }
  put_run();
  return file.Write(bytes.span(), job);
}

}  // namespace

std::unique_ptr<ResultFile> MakeBinvoxFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".binvox", path, job, &EncodeBinvox);
}

}  // namespace voxelpipe
