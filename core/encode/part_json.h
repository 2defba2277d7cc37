// The parts of a result as JSON: in summaries and in files that describe a result.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "job/part_table.h"

namespace voxelpipe {

// An array a column, with an element a part, by its number: label, priority, triangles; where parts are filled also
// open_edges, odd_columns, voxels; name. Throws std::bad_alloc.
nlohmann::ordered_json PartsJson(const PartTable& parts);

// The most memory that PartsJson and the text of it take, for a table of this shape.
uint64_t PartsJsonBytes(const PartShape& shape);

// The text of a JSON value with names in it that are untrusted input: bytes that are not UTF-8 become U+FFFD, and control
// characters of every kind are escaped (EscapeControls). `indent`: spaces a level, -1 for one line.
std::string JsonTextOf(const nlohmann::ordered_json& json, int indent);

}  // namespace voxelpipe
