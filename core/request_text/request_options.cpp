#include "request_text/request_options.h"

#include <array>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "base/limit_error.h"
#include "base/nearest_name.h"
#include "encode/format_registry.h"
#include "pipeline/plan/plan.h"
#include "request_text/axes.h"
#include "request_text/grid_like.h"
#include "request_text/numbers.h"
#include "request_text/shader_text.h"
#include "request_text/target_text.h"

namespace voxelpipe {
namespace {

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

// Builds a request of options, whose errors call them as the user does.
class Builder {
 public:
  Builder(const RequestOptions& options, OptionNames names) : options_(options), names_(names) {}

  absl::StatusOr<VoxelizeRequest> Build() {
    absl::Status s = BuildGrid();
    if (s.ok()) s = BuildChoices();
    if (s.ok()) s = BuildParts();
    if (s.ok()) s = BuildVertexShader();
    if (s.ok()) s = BuildTargets();
    if (s.ok()) s = ValidateRequest(request_);
    if (!s.ok()) return s;
    return std::move(request_);
  }

  absl::Status CheckGridLikeAlone() const {
    const std::pair<const char*, bool> others[] = {{"resolution", options_.resolution.has_value()},
                                                   {"voxel_size", options_.voxel_size.has_value()},
                                                   {"dims", options_.dims.has_value()},
                                                   {"origin", options_.origin.has_value()},
                                                   {"fit", options_.fit.has_value()},
                                                   {"clip", options_.clip.has_value()}};
    for (const auto& [name, given] : others) {
      if (!given) continue;
      return Wrong(Called("grid_like"), ": the whole grid is that of the file; leave ", Called(name), " out, or ",
                   Called("grid_like"));
    }
    return absl::OkStatus();
  }

  // "--voxel-size" or "voxel_size"
  std::string Called(std::string_view name) const {
    if (names_ == OptionNames::kKeys) return std::string(name);
    return absl::StrCat("--", absl::StrReplaceAll(std::string(name), {{"_", "-"}}));
  }
  absl::Status At(std::string_view option, const absl::Status& status) const {
    return Wrong(Called(option), ": ", std::string(status.message()));
  }

 private:
  template <typename T>
  absl::Status Read(std::string_view option, const std::optional<std::string>& text,
                    absl::StatusOr<T> (*parse)(std::string_view), std::optional<T>& value) const {
    if (!text) return absl::OkStatus();
    absl::StatusOr<T> parsed = parse(*text);
    if (!parsed.ok()) return At(option, parsed.status());
    value = *std::move(parsed);
    return absl::OkStatus();
  }

  template <typename T, size_t N>
  absl::Status Choose(std::string_view option, const std::string& text, const std::pair<const char*, T> (&choices)[N],
                      T& value) const {
    std::vector<std::string> known;
    for (const auto& [name, choice] : choices) {
      if (text == name) {
        value = choice;
        return absl::OkStatus();
      }
      known.emplace_back(name);
    }
    return Wrong(Called(option), ": ", UnknownChoice(text, known));
  }

  absl::Status BuildGrid() {
    GridRequest& grid = request_.grid;
    absl::Status s = Read("voxel_size", options_.voxel_size, &ParseVoxelSize, grid.voxel_size);
    if (s.ok()) s = Read("dims", options_.dims, &ParseDims, grid.dims);
    if (s.ok()) s = Read("origin", options_.origin, &ParsePoint, grid.origin);
    if (!s.ok()) return s;
    if (options_.resolution && (options_.voxel_size || options_.dims)) {
      return Wrong(Called("resolution"), " and ", Called(options_.voxel_size ? "voxel_size" : "dims"),
                   " exclude each other");
    }
    if (!grid.given() && (grid.origin || (grid.dims && grid.voxel_size))) {
      return Wrong(Called("dims"), ", ", Called("origin"), " and ", Called("voxel_size"),
                   " go together: give all three, or ", Called("dims"), " alone for a grid that fits the mesh");
    }
    if (options_.fit && (options_.voxel_size || options_.dims)) {
      return Wrong(Called("fit"), " goes with ", Called("resolution"), ", not with ",
                   Called(options_.voxel_size ? "voxel_size" : "dims"));
    }
    if (options_.resolution) {
      if (*options_.resolution < 1) return Wrong(Called("resolution"), ": at least 1 voxel");
      grid.resolution = *options_.resolution;
    }
    if (options_.padding < 0) return Wrong(Called("padding"), ": at least 0 voxels");
    grid.padding = options_.padding;
    constexpr std::pair<const char*, GridFit> kFits[] = {{"tight", GridFit::kTight}, {"cube", GridFit::kCube}};
    if (options_.fit) s = Choose("fit", *options_.fit, kFits, grid.fit);
    return s.ok() ? ClipGrid() : s;
  }

  // With clip: the grid that fits the box, in place of the request for one that fits the mesh.
  absl::Status ClipGrid() {
    GridRequest& grid = request_.grid;
    std::optional<Box3d> box;
    if (absl::Status s = Read("clip", options_.clip, &ParseBox, box); !s.ok() || !box) return s;
    if (grid.given()) {
      return Wrong(Called("clip"), ": ", Called("dims"), " and ", Called("origin"),
                   " give a grid already; leave them out, or ", Called("clip"));
    }
    const absl::StatusOr<GridSpec> fitted = FitGrid(grid, *box);
    if (!fitted.ok()) return At("clip", fitted.status());
    grid = GridRequest();
    grid.dims = fitted->dims;
    grid.origin = fitted->origin;
    grid.voxel_size = fitted->voxel_size;
    return absl::OkStatus();
  }

  absl::Status BuildChoices() {
    constexpr std::pair<const char*, Coverage> kCoverages[] = {{"conservative", Coverage::kConservative},
                                                               {"thin", Coverage::kThin},
                                                               {"center", Coverage::kCenter},
                                                               {"none", Coverage::kNone}};
    constexpr std::pair<const char*, Fill> kFills[] = {
        {"none", Fill::kNone}, {"parity", Fill::kParity}, {"nonzero", Fill::kNonzero}, {"flood", Fill::kFlood}};
    constexpr std::pair<const char*, Layout> kLayouts[] = {{"interleaved", Layout::kInterleaved},
                                                           {"planar", Layout::kPlanar}};
    constexpr std::pair<const char*, ResultKind> kKinds[] = {
        {"dense", ResultKind::kDense}, {"sparse", ResultKind::kSparse}, {"buckets", ResultKind::kBuckets}};
    constexpr std::pair<const char*, SimdChoice> kSimds[] = {{"auto", SimdChoice::kAuto},
                                                             {"avx512", SimdChoice::kAvx512},
                                                             {"avx2", SimdChoice::kAvx2},
                                                             {"scalar", SimdChoice::kScalar}};
    constexpr std::pair<const char*, BackendChoice> kBackends[] = {
        {"auto", BackendChoice::kAuto}, {"cpu", BackendChoice::kCpu}, {"cuda", BackendChoice::kCuda}};
    absl::Status s = Choose("coverage", options_.coverage, kCoverages, request_.coverage);
    if (s.ok()) s = Choose("fill", options_.fill, kFills, request_.fill);
    if (s.ok()) s = Choose("layout", options_.layout, kLayouts, request_.layout);
    if (s.ok()) s = Choose("result", options_.result.value_or("dense"), kKinds, request_.result);
    if (s.ok()) s = Choose("simd", options_.simd, kSimds, request_.simd);
    if (s.ok()) s = Choose("backend", options_.backend, kBackends, request_.backend);
    if (!s.ok()) return s;
    if (options_.threads < 0) return Wrong(Called("threads"), ": at least 0 (all cores)");
    request_.threads = options_.threads;
    request_.strict = options_.strict;
    return absl::OkStatus();
  }

  // "wheel*=3": split at the last =, as a name may hold one.
  absl::Status ReadRules(std::string_view option, const std::vector<std::string>& texts, int64_t min, int64_t max,
                         std::vector<PartRule>& rules) const {
    for (const std::string& text : texts) {
      const size_t at = text.rfind('=');
      if (at == std::string::npos) return Wrong(Called(option), ": '", text, "' is not of the form PATTERN=N");
      const absl::StatusOr<int64_t> number = ParseWhole(text.substr(at + 1), min, max);
      if (!number.ok()) return At(option, number.status());
      rules.push_back({text.substr(0, at), *number});
    }
    return absl::OkStatus();
  }

  absl::Status BuildParts() {
    constexpr std::pair<const char*, PartScope> kScopes[] = {{"whole", PartScope::kWhole},
                                                             {"file", PartScope::kFile},
                                                             {"node", PartScope::kNode},
                                                             {"mesh", PartScope::kMesh},
                                                             {"material", PartScope::kMaterial}};
    PartSelection& parts = request_.parts;
    absl::Status s = Choose("parts", options_.parts, kScopes, parts.scope);
    if (s.ok()) s = ReadRules("part_label", options_.part_labels, 1, UINT32_MAX, parts.labels);
    if (s.ok()) s = ReadRules("part_priority", options_.part_priorities, INT32_MIN, INT32_MAX, parts.priorities);
    if (!s.ok()) return s;
    parts.exclude = options_.exclude;
    for (const auto& [option, count] : {std::pair{"part_label", parts.labels.size()},
                                        {"part_priority", parts.priorities.size()},
                                        {"exclude", parts.exclude.size()}}) {
      if (count == 0) continue;
      if (parts.scope == PartScope::kWhole) {
        return Wrong(Called(option), ": goes with ", Called("parts"), " file, node, mesh or material");
      }
      if (count > kMaxPartRules) return Wrong(Called(option), ": ", count, " given; at most ", kMaxPartRules);
    }
    return absl::OkStatus();
  }

  absl::Status BuildVertexShader() {
    if (options_.vertex_shader) {
      absl::StatusOr<ShaderCall> call = ParseShaderCall(*options_.vertex_shader);
      if (!call.ok()) return At("vertex_shader", call.status());
      request_.vertex_shader = *std::move(call);
    }
    if (!options_.axes) return absl::OkStatus();
    const absl::StatusOr<Mat4d> axes = ParseAxes(*options_.axes);
    if (!axes.ok()) return At("axes", axes.status());
    absl::StatusOr<ShaderCall> turned = WithAxes(request_.vertex_shader, *axes);
    if (!turned.ok()) return At("axes", turned.status());
    request_.vertex_shader = *std::move(turned);
    return absl::OkStatus();
  }

  absl::Status BuildTargets() {
    absl::StatusOr<std::vector<TargetSpec>> targets = ParseTargets(options_.targets, options_.shader);
    if (!targets.ok()) return At(options_.targets.empty() ? "shader" : "target", targets.status());
    request_.targets = *std::move(targets);
    if (const OutputFormat* const format = FindFormat(options_.output_extension); format != nullptr) {
      UseDefaultsOf(*format, options_.targets.empty() && !options_.shader, !options_.result, request_);
    }
    return absl::OkStatus();
  }

  const RequestOptions& options_;
  const OptionNames names_;
  VoxelizeRequest request_;
};

}  // namespace

absl::StatusOr<RequestOptions> WithGridLike(RequestOptions options, OptionNames names) {
  if (!options.grid_like) return options;
  const std::string path = *std::exchange(options.grid_like, std::nullopt);
  const Builder builder(options, names);
  if (absl::Status s = builder.CheckGridLikeAlone(); !s.ok()) return s;
  const absl::StatusOr<GridPlace> place = ReadGridPlace(path);
  if (!place.ok()) return Wrong(builder.Called("grid_like"), ": ", path, ": ", std::string(place.status().message()));
  // As texts that give back every bit, so that equal grids are equal options.
  const auto text = [](const Vec3d& v) {
    return absl::StrCat(ExactText(v.x), ",", ExactText(v.y), ",", ExactText(v.z));
  };
  options.dims = absl::StrCat(place->dims[0], ",", place->dims[1], ",", place->dims[2]);
  options.origin = text(place->origin);
  options.voxel_size = text(place->voxel_size);
  return options;
}

absl::StatusOr<VoxelizeRequest> BuildRequest(const RequestOptions& given, OptionNames names) {
  const absl::StatusOr<RequestOptions> options = WithGridLike(given, names);
  if (!options.ok()) return options.status();
  return Builder(*options, names).Build();
}

}  // namespace voxelpipe
