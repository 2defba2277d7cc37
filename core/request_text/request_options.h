// The options of a request as a user types them: on the command line as flags, in a manifest as keys.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "absl/status/statusor.h"
#include "job/request.h"

namespace voxelpipe {

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
  std::string parts = "whole";
  std::vector<std::string> part_labels{}, part_priorities{};  // PATTERN=N
  std::vector<std::string> exclude{};                         // patterns
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

// Of what an option is a part.
enum class OptionGroup : uint8_t { kGrid, kValues, kExecution };

// One option: its name, where its value is, and its help.
struct RequestOption {
  std::string_view name;  // "voxel_size", a key; as a flag --voxel-size
  std::variant<std::optional<int64_t> RequestOptions::*, int64_t RequestOptions::*, int RequestOptions::*,
               bool RequestOptions::*, std::string RequestOptions::*, std::optional<std::string> RequestOptions::*,
               std::vector<std::string> RequestOptions::*>
      value;
  OptionGroup group;
  std::string_view type;  // "H[,HY,HZ]"; empty for a switch
  std::string_view text;  // what it does, with its default
};

// All options, in the order of the help. A list may be given several times; its name here is the singular.
std::span<const RequestOption> ListRequestOptions();

// How errors call an option: "--voxel-size" or "voxel_size".
enum class OptionNames : uint8_t { kFlags, kKeys };

// INVALID_ARGUMENT naming the option at fault: a text that cannot be parsed, options that exclude each other, a shader,
// blend or parameter that does not exist.
absl::StatusOr<VoxelizeRequest> BuildRequest(const RequestOptions& options, OptionNames names = OptionNames::kFlags);

// In: options, perhaps with `grid_like`. Out: the same with the dims, origin and voxel size of that file in its place.
// INVALID_ARGUMENT as BuildRequest, which calls it.
absl::StatusOr<RequestOptions> WithGridLike(RequestOptions options, OptionNames names = OptionNames::kFlags);

}  // namespace voxelpipe
