// The health of a mesh as `voxelpipe info` prints it.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "mesh/health/health.h"

namespace voxelpipe::cli {

// In: the path of the mesh file, for the next step. Out: the object `health` of `info --json`.
nlohmann::ordered_json HealthJson(const MeshHealth& health, const std::string& path);

// The same as rows of a table: name and text.
std::vector<std::pair<std::string, std::string>> HealthRows(const MeshHealth& health, const std::string& path);

}  // namespace voxelpipe::cli
