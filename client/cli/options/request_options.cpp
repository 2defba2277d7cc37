#include "options/request_options.h"

#include <array>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/nearest_name.h"
#include "encode/format_registry.h"
#include "options/axes.h"
#include "options/grid_like.h"
#include "options/parse.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::cli {
namespace {

absl::Status AtOption(const char* option, const absl::Status& status) {
  return absl::InvalidArgumentError(absl::StrCat(option, ": ", std::string(status.message())));
}

template <typename T>
absl::Status Read(const char* option, const std::optional<std::string>& text,
                  absl::StatusOr<T> (*parse)(std::string_view), std::optional<T>& value) {
  if (!text) return absl::OkStatus();
  absl::StatusOr<T> parsed = parse(*text);
  if (!parsed.ok()) return AtOption(option, parsed.status());
  value = *std::move(parsed);
  return absl::OkStatus();
}

template <typename T, size_t N>
absl::Status Choose(const char* option, const std::string& text,
                    const std::array<std::pair<const char*, T>, N>& choices, T& value) {
  std::vector<std::string> known;
  for (const auto& [name, choice] : choices) {
    if (text == name) {
      value = choice;
      return absl::OkStatus();
    }
    known.emplace_back(name);
  }
  return absl::InvalidArgumentError(absl::StrCat(option, ": ", UnknownChoice(text, known)));
}

// With --clip: the grid that fits the box, in place of the request for one that fits the mesh.
absl::Status ClipGrid(const RequestOptions& options, GridRequest& grid) {
  std::optional<Box3d> box;
  if (absl::Status s = Read("--clip", options.clip, &ParseBox, box); !s.ok() || !box) return s;
  if (grid.given()) {
    return absl::InvalidArgumentError("--clip: --dims and --origin give a grid already; leave them out, or --clip");
  }
  const absl::StatusOr<GridSpec> fitted = FitGrid(grid, *box);
  if (!fitted.ok()) return AtOption("--clip", fitted.status());
  grid = GridRequest();
  grid.dims = fitted->dims;
  grid.origin = fitted->origin;
  grid.voxel_size = fitted->voxel_size;
  return absl::OkStatus();
}

absl::Status BuildGrid(const RequestOptions& options, GridRequest& grid) {
  if (absl::Status s = Read("--voxel-size", options.voxel_size, &ParseVoxelSize, grid.voxel_size); !s.ok()) return s;
  if (absl::Status s = Read("--dims", options.dims, &ParseDims, grid.dims); !s.ok()) return s;
  if (absl::Status s = Read("--origin", options.origin, &ParsePoint, grid.origin); !s.ok()) return s;
  if (options.resolution && options.voxel_size) {
    return absl::InvalidArgumentError("--resolution and --voxel-size exclude each other");
  }
  if (options.resolution && options.dims) {
    return absl::InvalidArgumentError("--resolution and --dims exclude each other");
  }
  if (!grid.given() && (grid.origin || (grid.dims && grid.voxel_size))) {
    return absl::InvalidArgumentError(
        "--dims, --origin and --voxel-size go together: give all three, or --dims alone for a grid that fits the mesh");
  }
  if (options.fit && (options.voxel_size || options.dims)) {
    return absl::InvalidArgumentError(
        absl::StrCat("--fit goes with --resolution, not with ", options.voxel_size ? "--voxel-size" : "--dims"));
  }
  if (options.resolution) {
    if (*options.resolution < 1) return absl::InvalidArgumentError("--resolution: at least 1 voxel");
    grid.resolution = *options.resolution;
  }
  if (options.padding < 0) return absl::InvalidArgumentError("--padding: at least 0 voxels");
  grid.padding = options.padding;
  constexpr std::array<std::pair<const char*, GridFit>, 2> kFits = {
      {{"tight", GridFit::kTight}, {"cube", GridFit::kCube}}};
  if (options.fit) {
    if (absl::Status s = Choose("--fit", *options.fit, kFits, grid.fit); !s.ok()) return s;
  }
  return ClipGrid(options, grid);
}

}  // namespace

absl::StatusOr<RequestOptions> WithGridLike(RequestOptions options) {
  if (!options.grid_like) return options;
  const std::string path = *std::exchange(options.grid_like, std::nullopt);
  const std::pair<const char*, bool> others[] = {{"--resolution", options.resolution.has_value()},
                                                 {"--voxel-size", options.voxel_size.has_value()},
                                                 {"--dims", options.dims.has_value()},
                                                 {"--origin", options.origin.has_value()},
                                                 {"--fit", options.fit.has_value()},
                                                 {"--clip", options.clip.has_value()}};
  for (const auto& [name, given] : others) {
    if (!given) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("--grid-like: the whole grid is that of the file; leave ", name, " out, or --grid-like"));
  }
  const absl::StatusOr<GridPlace> place = ReadGridPlace(path);
  if (!place.ok()) return AtOption(absl::StrCat("--grid-like: ", path).c_str(), place.status());
  // As texts that give back every bit, so that equal grids are equal options.
  const auto text = [](const Vec3d& v) { return absl::StrFormat("%.17g,%.17g,%.17g", v.x, v.y, v.z); };
  options.dims = absl::StrCat(place->dims[0], ",", place->dims[1], ",", place->dims[2]);
  options.origin = text(place->origin);
  options.voxel_size = text(place->voxel_size);
  return options;
}

absl::StatusOr<VoxelizeRequest> BuildRequest(const RequestOptions& given) {
  const absl::StatusOr<RequestOptions> with_grid = WithGridLike(given);
  if (!with_grid.ok()) return with_grid.status();
  const RequestOptions& options = *with_grid;
  VoxelizeRequest request;
  if (absl::Status s = BuildGrid(options, request.grid); !s.ok()) return s;

  constexpr std::array<std::pair<const char*, Coverage>, 4> kCoverages = {{{"conservative", Coverage::kConservative},
                                                                           {"thin", Coverage::kThin},
                                                                           {"center", Coverage::kCenter},
                                                                           {"none", Coverage::kNone}}};
  if (absl::Status s = Choose("--coverage", options.coverage, kCoverages, request.coverage); !s.ok()) return s;
  constexpr std::array<std::pair<const char*, Fill>, 4> kFills = {
      {{"none", Fill::kNone}, {"parity", Fill::kParity}, {"nonzero", Fill::kNonzero}, {"flood", Fill::kFlood}}};
  if (absl::Status s = Choose("--fill", options.fill, kFills, request.fill); !s.ok()) return s;
  constexpr std::array<std::pair<const char*, Layout>, 2> kLayouts = {
      {{"interleaved", Layout::kInterleaved}, {"planar", Layout::kPlanar}}};
  if (absl::Status s = Choose("--layout", options.layout, kLayouts, request.layout); !s.ok()) return s;
  constexpr std::array<std::pair<const char*, ResultKind>, 3> kKinds = {
      {{"dense", ResultKind::kDense}, {"sparse", ResultKind::kSparse}, {"buckets", ResultKind::kBuckets}}};
  if (absl::Status s = Choose("--result", options.result.value_or("dense"), kKinds, request.result); !s.ok()) return s;
  constexpr std::array<std::pair<const char*, SimdChoice>, 4> kSimds = {{{"auto", SimdChoice::kAuto},
                                                                         {"avx512", SimdChoice::kAvx512},
                                                                         {"avx2", SimdChoice::kAvx2},
                                                                         {"scalar", SimdChoice::kScalar}}};
  if (absl::Status s = Choose("--simd", options.simd, kSimds, request.simd); !s.ok()) return s;
  constexpr std::array<std::pair<const char*, BackendChoice>, 3> kBackends = {
      {{"auto", BackendChoice::kAuto}, {"cpu", BackendChoice::kCpu}, {"cuda", BackendChoice::kCuda}}};
  if (absl::Status s = Choose("--backend", options.backend, kBackends, request.backend); !s.ok()) return s;
  if (options.threads < 0) return absl::InvalidArgumentError("--threads: at least 0 (all cores)");
  request.threads = options.threads;
  request.strict = options.strict;

  if (options.vertex_shader) {
    absl::StatusOr<ShaderCall> call = ParseShaderCall(*options.vertex_shader);
    if (!call.ok()) return AtOption("--vertex-shader", call.status());
    request.vertex_shader = *std::move(call);
  }
  if (options.axes) {
    const absl::StatusOr<Mat4d> axes = ParseAxes(*options.axes);
    if (!axes.ok()) return AtOption("--axes", axes.status());
    absl::StatusOr<ShaderCall> turned = WithAxes(request.vertex_shader, *axes);
    if (!turned.ok()) return AtOption("--axes", turned.status());
    request.vertex_shader = *std::move(turned);
  }
  absl::StatusOr<std::vector<TargetSpec>> targets = ResolveTargets(options.targets, options.shader);
  if (!targets.ok()) return AtOption(options.targets.empty() ? "--shader" : "--target", targets.status());
  request.targets = *std::move(targets);
  if (const OutputFormat* const format = FindFormat(options.output_extension); format != nullptr) {
    UseDefaultsOf(*format, options.targets.empty() && !options.shader, !options.result, request);
  }
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  return request;
}

}  // namespace voxelpipe::cli
