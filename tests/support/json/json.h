// JSON in tests: parsed and printed in one file, as every file that does it by itself compiles for seconds.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

namespace voxelpipe::testing {

// Text that is not JSON: throws nlohmann::json::parse_error, or gives a discarded value.
nlohmann::json ParseJson(std::string_view text, bool allow_exceptions = true);
nlohmann::json ParseJson(const std::vector<uint8_t>& bytes);

}  // namespace voxelpipe::testing

// Where GoogleTest looks for how to print a value.
NLOHMANN_JSON_NAMESPACE_BEGIN
void PrintTo(const json& value, std::ostream* stream);
NLOHMANN_JSON_NAMESPACE_END
