#include "support/json/json.h"

#include <ostream>

namespace voxelpipe::testing {

nlohmann::json ParseJson(std::string_view text, bool allow_exceptions) {
  return nlohmann::json::parse(text, nullptr, allow_exceptions);
}

nlohmann::json ParseJson(const std::vector<uint8_t>& bytes) {
  return ParseJson(std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

}  // namespace voxelpipe::testing

NLOHMANN_JSON_NAMESPACE_BEGIN

void PrintTo(const json& value, std::ostream* stream) {
  *stream << value.dump(-1, ' ', false, json::error_handler_t::replace);
}

NLOHMANN_JSON_NAMESPACE_END
