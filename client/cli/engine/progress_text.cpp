#include "engine/progress_text.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "engine/report.h"

namespace voxelpipe::cli {
namespace {

std::string Duration(double ms) {
  const auto seconds = uint64_t(std::ceil(ms / 1000));
  if (seconds < 60) return absl::StrCat(seconds, " s");
  if (seconds < 3600) return absl::StrFormat("%d min %02d s", seconds / 60, seconds % 60);
  return absl::StrFormat("%d h %02d min", seconds / 3600, seconds / 60 % 60);
}

std::string VoxelRate(double per_second) {
  constexpr const char* kUnits[] = {"", " k", " M", " G", " T"};
  size_t unit = 0;
  for (; per_second >= 1000 && unit < 4; ++unit) per_second /= 1000;
  return absl::StrFormat("%.3g%s voxels/s", per_second, kUnits[unit]);
}

}  // namespace

std::optional<double> EtaMs(const ProgressState& state) {
  if (state.items < 2 || state.ended == 0) return std::nullopt;
  return state.elapsed_ms / double(state.ended) * double(state.items - std::min(state.ended, state.items));
}

std::string ProgressLine(const ProgressState& state, size_t columns) {
  constexpr int kWidth = 10;  // leaves room for the rest in 80 columns
  const bool list = state.items > 1;
  const double share = std::clamp(list ? double(state.ended) / double(state.items) : state.fraction, 0.0, 1.0);
  const int filled = int(share * kWidth);
  std::string line = absl::StrFormat("[%s%s] %3d %%  ", std::string(size_t(filled), '#'),
                                     std::string(size_t(kWidth - filled), '.'), int(share * 100));
  std::string gap;
  const auto add = [&](const std::string& text) {
    absl::StrAppend(&line, gap, text);
    gap = ", ";
  };
  if (list) add(absl::StrCat(state.ended, " of ", state.items));
  if (state.failed > 0) add(absl::StrCat(state.failed, " failed"));
  if (list && state.ended > 0 && state.elapsed_ms > 0) {
    add(absl::StrFormat("%.3g items/s", double(state.ended) * 1000 / state.elapsed_ms));
  }
  if (const std::optional<double> eta = EtaMs(state)) add(Duration(*eta) + " left");
  if (!state.stage.empty()) add(state.stage);
  if (state.voxels_per_second) add(VoxelRate(*state.voxels_per_second));
  return line.substr(0, columns);
}

std::string ProgressJson(const ProgressState& state) {
  const std::optional<double> eta = EtaMs(state);
  const nlohmann::ordered_json json = {
      {"stage", state.stage},
      {"fraction", std::clamp(state.fraction, 0.0, 1.0)},
      {"item", state.item},
      {"items", state.items},
      {"elapsed_ms", std::llround(state.elapsed_ms)},
      {"eta_ms", eta ? nlohmann::ordered_json(std::llround(*eta)) : nlohmann::ordered_json(nullptr)}};
  return JsonText(json);  // a stage may be a server's text
}

}  // namespace voxelpipe::cli
