#include "engine/health_report.h"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "engine/report.h"
#include "mesh/health/fill_advice.h"
#include "mesh/health/health_facts.h"

namespace voxelpipe::cli {
namespace {

// As a shell reads it: quoted where it has to be.
std::string ForShell(const std::string& path) {
  constexpr char kPlain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_./+,:@%=-";
  if (!path.empty() && path.find_first_not_of(kPlain) == std::string::npos) return path;
  std::string quoted = "'";
  for (const char c : path) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

// Empty where nothing can be voxelized.
std::string NextStep(const FillAdvice& advice, const std::string& path) {
  if (advice.fill == Fill::kNone) return "";
  const std::string name = path == "-" ? "voxels" : std::filesystem::path(path).stem().string();
  const std::string output = name + ".npy";
  return absl::StrCat("voxelpipe voxelize ", ForShell(path), " --fill ", std::string(Name(advice.fill)), " -o ",
                      ForShell(output));
}

}  // namespace

nlohmann::ordered_json HealthJson(const MeshHealth& health, const std::string& path) {
  nlohmann::ordered_json json;
  ForEachHealthFact(health, [&json](const char* name, const auto& value) { json[name] = value; });
  const std::string next = NextStep(AdviseFill(health), path);
  json["next"] = next.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(next);
  return json;
}

std::vector<std::pair<std::string, std::string>> HealthRows(const MeshHealth& health, const std::string& path) {
  std::vector<std::pair<std::string, std::string>> rows;
  const EdgeCounts& edges = health.edges;
  const OverlapCounts& overlaps = health.overlaps;
  rows.emplace_back("edges", absl::StrCat(WithCommas(edges.edges), ", ", WithCommas(edges.open), " open, ",
                                          WithCommas(edges.non_manifold), " non-manifold, ",
                                          WithCommas(edges.inconsistent), " of inconsistent orientation"));
  rows.emplace_back("duplicates", absl::StrCat(WithCommas(health.duplicate_triangles), " triangles, ",
                                               WithCommas(health.duplicate_vertices), " vertices (by position)"));
  if (health.not_finite_vertices > 0) {
    rows.emplace_back("not finite", absl::StrCat(WithCommas(health.not_finite_vertices), " vertices"));
  }
  rows.emplace_back(
      "shells",
      absl::StrCat(WithCommas(health.shells), ", ", WithCommas(health.closed_shells), " closed, ",
                   WithCommas(health.flipped_shells), " flipped",
                   overlaps.cavities == 0 ? "" : absl::StrCat(" (", WithCommas(overlaps.cavities), " as cavities)")));
  std::string pairs;
  const auto add = [&](uint64_t count, const char* text) {
    if (count > 0) absl::StrAppend(&pairs, pairs.empty() ? "" : ", ", WithCommas(count), text);
  };
  add(overlaps.overlapping, " overlap others");
  add(overlaps.nested, " inside others");
  add(overlaps.boxes_only, " whose boxes overlap");
  add(overlaps.undecided, " not decided");
  rows.emplace_back("overlaps", pairs.empty() ? "none" : pairs);
  rows.emplace_back("volume", absl::StrFormat("%.6g in closed shells", health.volume));
  rows.emplace_back("watertight", health.watertight ? "yes" : "no");
  const FillAdvice advice = AdviseFill(health);
  rows.emplace_back("fill", absl::StrCat(std::string(Name(advice.fill)), ": ", advice.why));
  if (const std::string next = NextStep(advice, path); !next.empty()) rows.emplace_back("next", next);
  return rows;
}

}  // namespace voxelpipe::cli
