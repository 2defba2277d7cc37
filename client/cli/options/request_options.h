// From the options of `voxelpipe voxelize` to a request.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "job/request.h"

namespace voxelpipe::cli {

// As typed; absent if the option was not given.
struct RequestOptions {
  std::optional<int64_t> resolution{};
  std::optional<std::string> voxel_size{}, dims{}, origin{};
  std::optional<std::string> fit{};
  std::optional<std::string> grid_like{};  // path of an earlier result
  std::optional<std::string> axes{};
  std::optional<std::string> clip{};
  int64_t padding = 0;
  std::string coverage = "conservative";
  std::string fill = "none";
  std::optional<std::string> shader{};
  std::optional<std::string> vertex_shader{};
  std::vector<std::string> targets{};
  std::string layout = "interleaved";
  std::optional<std::string> result{};
  std::string backend = "auto";
  std::string simd = "auto";
  int threads = 0;
  bool strict = false;
  // Extension of the file that the result goes to, whose format gives what is left open (UseDefaultsOf); empty: none.
  std::string output_extension{};
};

// INVALID_ARGUMENT naming the option at fault: a text that cannot be parsed, options that exclude each other, a shader,
// blend or parameter that does not exist.
absl::StatusOr<VoxelizeRequest> BuildRequest(const RequestOptions& options);

// In: options, perhaps with `grid_like`. Out: the same with the dims, origin and voxel size of that file in its place.
// INVALID_ARGUMENT as BuildRequest, which calls it.
absl::StatusOr<RequestOptions> WithGridLike(RequestOptions options);

}  // namespace voxelpipe::cli
