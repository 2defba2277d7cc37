// How far a command is, as a line on a terminal and as JSON.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace voxelpipe::cli {

struct ProgressState {
  std::string stage;    // of the item that runs; "done" at the end
  double fraction = 0;  // in [0, 1] of the stage
  size_t item = 0;      // 1 for the first; of a batch, which runs several at once: how many have ended
  size_t items = 1;
  size_t ended = 0;   // of the items
  size_t failed = 0;  // of those that have ended
  double elapsed_ms = 0;
  std::optional<double> voxels_per_second{};  // of the item that runs, once its grid is known
};

// Milliseconds to the end of a list, at the rate of the items that have ended. Empty for one item and before the first
// has ended.
std::optional<double> EtaMs(const ProgressState& state);

// "[####....]  40 %  2 of 5, 1.5 items/s, 2 s left, fine_raster", at most `columns` bytes. The bar is the share of the
// list, or of the stage of a single item.
std::string ProgressLine(const ProgressState& state, size_t columns);

// {"stage", "fraction", "item", "items", "elapsed_ms", "eta_ms" (null if not known)} on one line.
std::string ProgressJson(const ProgressState& state);

}  // namespace voxelpipe::cli
