// The flood of a grid of bits against a plain breadth-first search, voxel by voxel.
#include "cpu/base/enclosed.h"

#include <array>
#include <functional>
#include <random>
#include <vector>

#include "base/threads.h"
#include "gtest/gtest.h"

namespace voxelpipe::cpu {
namespace {

using Dims = std::array<int64_t, 3>;
using IsShell = std::function<bool(int64_t x, int64_t y, int64_t z)>;

struct Grid {
  Dims dims;
  std::vector<bool> voxels;
  std::vector<bool>::reference at(int64_t x, int64_t y, int64_t z) {
    return voxels[size_t(x + dims[0] * (y + dims[1] * z))];
  }
};

Grid Shell(const Dims& dims, const IsShell& is_shell) {
  Grid grid{dims, std::vector<bool>(size_t(dims[0] * dims[1] * dims[2]))};
  for (int64_t z = 0; z < dims[2]; ++z) {
    for (int64_t y = 0; y < dims[1]; ++y) {
      for (int64_t x = 0; x < dims[0]; ++x) grid.at(x, y, z) = is_shell(x, y, z);
    }
  }
  return grid;
}

// The voxels that a search from outside does not reach.
Grid Search(Grid shell) {
  const Dims& dims = shell.dims;
  Grid enclosed{dims, std::vector<bool>(shell.voxels.size(), true)};
  std::vector<std::array<int64_t, 3>> next;
  const auto visit = [&](int64_t x, int64_t y, int64_t z) {
    if (x < 0 || y < 0 || z < 0 || x >= dims[0] || y >= dims[1] || z >= dims[2]) return;
    if (shell.at(x, y, z) || !enclosed.at(x, y, z)) return;
    enclosed.at(x, y, z) = false;
    next.push_back({x, y, z});
  };
  for (int64_t z = 0; z < dims[2]; ++z) {
    for (int64_t y = 0; y < dims[1]; ++y) {
      for (int64_t x = 0; x < dims[0]; ++x) {
        if (x == 0 || y == 0 || z == 0 || x == dims[0] - 1 || y == dims[1] - 1 || z == dims[2] - 1) visit(x, y, z);
      }
    }
  }
  while (!next.empty()) {
    const auto [x, y, z] = next.back();
    next.pop_back();
    visit(x - 1, y, z), visit(x + 1, y, z), visit(x, y - 1, z), visit(x, y + 1, z), visit(x, y, z - 1),
        visit(x, y, z + 1);
  }
  return enclosed;
}

// By one thread and by two, in blocks of many layers and of few. `all_open`: the search must leave nothing but the
// shell.
void ExpectFloodIsTheSearch(const Grid& shell, bool all_open = false) {
  const Grid expected = Search(shell);
  ASSERT_TRUE(!all_open || expected.voxels == shell.voxels) << "a way is closed";
  const Dims& dims = shell.dims;
  absl::StatusOr<BitGrid> bits = BitGrid::Create(dims);
  ASSERT_TRUE(bits.ok());
  for (int64_t n = 0; n < int64_t(shell.voxels.size()); ++n) {
    const int64_t x = n % dims[0];
    if (shell.voxels[size_t(n)]) bits->row(n / dims[0])[size_t(x / 32)] |= 1u << (x % 32);
  }
  for (const int threads : {1, 2}) {
    for (const int64_t layers : {0, 1, 2, 3, 16}) {
      RunOnThreads(threads, [&] {
        const JobContext job;
        absl::StatusOr<BitGrid> enclosed = Enclosed(*bits, dims, job, layers);
        ASSERT_TRUE(enclosed.ok()) << enclosed.status();
        for (int64_t n = 0; n < int64_t(shell.voxels.size()); ++n) {
          const int64_t x = n % dims[0];
          ASSERT_EQ((enclosed->row(n / dims[0])[size_t(x / 32)] >> (x % 32)) & 1, expected.voxels[size_t(n)])
              << "voxel " << n << " of " << dims[0] << " x " << dims[1] << " x " << dims[2] << ", blocks of " << layers;
        }
        for (int64_t row = 0; row < enclosed->rows(); ++row) {
          ASSERT_EQ(enclosed->row(row).back() & ~enclosed->last_word_mask(), 0u) << "padding of row " << row;
        }
      });
      if (::testing::Test::HasFatalFailure()) return;
    }
  }
}

// Below, at and above words of 32 and of 64 voxels.
constexpr int64_t kSizes[] = {1, 2, 3, 31, 32, 33, 63, 64, 65, 127, 128, 129};

TEST(Enclosed, IsWhatASearchLeavesWhateverTheSizeOfTheGrid) {
  std::mt19937 random(3);
  for (const int64_t size : kSizes) {
    for (const Dims& dims : {Dims{size, 9, 11}, Dims{7, size, 6}, Dims{5, 8, size}, Dims{size, 1, 9}, Dims{size, 7, 1},
                             Dims{1, size, 7}, Dims{size, 1, 1}, Dims{1, 1, size}}) {
      // From single voxels to single ways; about 69 of 100 the ways are long.
      for (const uint32_t share : {5u, 30u, 50u, 65u, 69u, 80u}) {
        ExpectFloodIsTheSearch(Shell(dims, [&](int64_t, int64_t, int64_t) { return random() % 100 < share; }));
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST(Enclosed, IsNothingWithoutAShellAndAllThatIsShell) {
  for (const int64_t size : kSizes) {
    ExpectFloodIsTheSearch(Shell({size, 5, 6}, [](int64_t, int64_t, int64_t) { return false; }));
    ExpectFloodIsTheSearch(Shell({size, 5, 6}, [](int64_t, int64_t, int64_t) { return true; }));
  }
}

// Boxes in boxes, every second one closed: what is between a closed one and the open one around it is outside.
TEST(Enclosed, FillsNestedBoxes) {
  for (const bool open : {false, true}) {
    for (int side = 0; side < 6; ++side) {
      const Dims dims{70, 41, 37};
      ExpectFloodIsTheSearch(Shell(dims, [&](int64_t x, int64_t y, int64_t z) {
        const int64_t at[3] = {x, y, z};
        int64_t box = INT64_MAX;
        for (size_t a = 0; a < 3; ++a) box = std::min({box, at[a], dims[a] - 1 - at[a]});
        if (box % 3 != 1) return false;
        // A hole of one voxel in the middle of a side.
        const auto axis = size_t(side % 3), u = (axis + 1) % 3, v = (axis + 2) % 3;
        const bool on_side = (side < 3 ? at[axis] : dims[axis] - 1 - at[axis]) == box;
        const bool hole = on_side && at[u] == dims[u] / 2 && at[v] == dims[v] / 2;
        return !(open && box % 2 == 0 && hole);
      }));
      if (HasFatalFailure()) return;
    }
  }
}

// A box without one of its sides; one whose broad front goes through many blocks.
TEST(Enclosed, IsTheWallsOfAnOpenBox) {
  for (int side = 0; side < 6; ++side) {
    const Dims dims{130, 60, 66};
    ExpectFloodIsTheSearch(Shell(dims,
                                 [&](int64_t x, int64_t y, int64_t z) {
                                   const int64_t at[3] = {x, y, z};
                                   bool inside = true, wall = false;
                                   for (size_t a = 0; a < 3; ++a) {
                                     inside = inside && at[a] >= 3 && at[a] < dims[a] - 3;
                                     wall = wall || (at[a] == 3 && side != int(a)) ||
                                            (at[a] == dims[a] - 4 && side != int(a) + 3);
                                   }
                                   return inside && wall;
                                 }),
                           /*all_open=*/true);
    if (HasFatalFailure()) return;
  }
}

// Passages of one voxel between cells of one voxel. Depth first: long ways that turn at every cell.
Grid Maze(const Dims& cells, uint32_t seed) {
  Grid shell{{2 * cells[0] + 1, 2 * cells[1] + 1, 2 * cells[2] + 1}, {}};
  shell.voxels.assign(size_t(shell.dims[0] * shell.dims[1] * shell.dims[2]), true);
  std::mt19937 random(seed);
  std::vector<Dims> way{{0, 0, 0}};
  shell.at(1, 1, 1) = shell.at(1, 1, 0) = false;
  while (!way.empty()) {
    const Dims cell = way.back();
    std::vector<Dims> next;
    for (size_t a = 0; a < 3; ++a) {
      for (const int64_t step : {-1, 1}) {
        Dims to = cell;
        to[a] += step;
        if (to[a] < 0 || to[a] >= cells[a]) continue;
        if (shell.at(2 * to[0] + 1, 2 * to[1] + 1, 2 * to[2] + 1)) next.push_back(to);
      }
    }
    if (next.empty()) {
      way.pop_back();
      continue;
    }
    const Dims to = next[random() % next.size()];
    shell.at(2 * to[0] + 1, 2 * to[1] + 1, 2 * to[2] + 1) = false;
    shell.at(cell[0] + to[0] + 1, cell[1] + to[1] + 1, cell[2] + to[2] + 1) = false;
    way.push_back(to);
  }
  return shell;
}

TEST(Enclosed, IsTheWallsOfAMaze) {
  for (const Dims& cells : {Dims{16, 16, 16}, Dims{33, 8, 9}, Dims{7, 31, 12}, Dims{5, 6, 40}, Dims{63, 20, 1}}) {
    Grid maze = Maze(cells, uint32_t(cells[0]));
    ExpectFloodIsTheSearch(maze, /*all_open=*/true);
    if (HasFatalFailure()) return;
    maze.at(1, 1, 0) = true;  // closed: all of it
    ExpectFloodIsTheSearch(maze);
    if (HasFatalFailure()) return;
  }
}

// One passage through all cells, along each axis back and forth.
TEST(Enclosed, FollowsASerpentine) {
  for (size_t fast = 0; fast < 3; ++fast) {
    for (const size_t middle : {(fast + 1) % 3, (fast + 2) % 3}) {
      const size_t slow = 3 - fast - middle;
      Dims dims{};
      dims[fast] = 45, dims[middle] = 17, dims[slow] = 13;
      // Walls between layers along the slow axis, and between passages; each has a door at the end of the passage.
      ExpectFloodIsTheSearch(
          Shell(dims,
                [&](int64_t x, int64_t y, int64_t z) {
                  const int64_t at[3] = {x, y, z};
                  for (size_t a = 0; a < 3; ++a) {
                    if (at[a] == 0 || at[a] == dims[a] - 1) return !(at[fast] == 0 && at[middle] == 1 && at[slow] == 1);
                  }
                  const int64_t passages = (dims[middle] - 1) / 2;
                  const int64_t layer = at[slow] / 2;
                  if (at[slow] % 2 == 0) {  // a wall below `layer`: its door is where the layer before it ends
                    const int64_t end = layer % 2 == 0 ? 1 : dims[middle] - 2;
                    const bool forward = layer * passages % 2 == 0;
                    return !(at[middle] == end && at[fast] == (forward ? 1 : dims[fast] - 2));
                  }
                  if (at[middle] % 2 != 0) return false;
                  const int64_t before = layer % 2 == 0 ? at[middle] / 2 : passages - at[middle] / 2;
                  const bool forward = (layer * passages + before) % 2 == 0;
                  return at[fast] != (forward ? 1 : dims[fast] - 2);
                }),
          /*all_open=*/true);
      if (HasFatalFailure()) return;
    }
  }
}

TEST(Enclosed, EndsWithItsJob) {
  const Dims dims{64, 64, 64};
  absl::StatusOr<BitGrid> shell = BitGrid::Create(dims);
  ASSERT_TRUE(shell.ok());
  JobContext job;
  job.Cancel();
  for (const int64_t layers : {0, 4}) {
    EXPECT_EQ(Enclosed(*shell, dims, job, layers).status().code(), absl::StatusCode::kCancelled);
  }
}

}  // namespace
}  // namespace voxelpipe::cpu
