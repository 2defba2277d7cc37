#include "encode/raw_description.h"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "encode/npy.h"
#include "encode/output_path.h"
#include "encode/part_json.h"

namespace voxelpipe {
namespace {

using nlohmann::ordered_json;

constexpr std::string_view kSuffix = ".json";
constexpr char kOrder[] =
    "x fastest: voxel (i, j, k) is n = i + nx*(j + ny*k); bit n is (byte[n/8] >> (n%8)) & 1; little endian";

ordered_json MatrixJson(const Mat4d& matrix) {
  ordered_json rows = ordered_json::array();
  for (const auto& row : matrix.m) rows.push_back({row[0], row[1], row[2], row[3]});
  return rows;
}

}  // namespace

std::string RawDescriptionPath(const std::string& path) {
  return FitFileName(path, kSuffix.size()) + std::string(kSuffix);
}

std::string DescribeRaw(const ResultHeader& header, const std::vector<std::string>& files, std::string_view sha256,
                        const PartTable& parts) {
  const GridSpec& grid = header.grid;
  ordered_json json;
  json["dims"] = grid.dims;
  json["origin"] = {grid.origin.x, grid.origin.y, grid.origin.z};
  json["voxel_size"] = {grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z};
  json["index_to_world"] = MatrixJson(grid.index_to_world());
  json["layout"] = header.layout == Layout::kPlanar ? "planar" : "interleaved";
  json["order"] = kOrder;
  json["targets"] = ordered_json::array();
  for (size_t i = 0; i < files.size(); ++i) {
    const TargetSpec& spec = header.specs[i];
    const ArraySpec& array = header.arrays[i];
    json["targets"].push_back({{"file", std::filesystem::path(files[i]).filename().string()},
                               {"format", std::string(Name(spec.format))},
                               {"components", spec.components},
                               {"encoding", std::string(Name(spec.encoding))},
                               {"blend", std::string(Name(spec.blend))},
                               {"shader", spec.shader.name},
                               {"dtype", array.type == ElementType::kBit ? "bit" : std::string(NpyDescr(array.type))},
                               {"shape", array.shape},
                               {"bytes", array.bytes()}});
  }
  json["hash"] = sha256.empty() ? ordered_json(nullptr) : ordered_json(std::string(sha256));
  if (!parts.empty()) json["parts"] = PartsJson(parts);
  return JsonTextOf(json, 1) + "\n";
}

}  // namespace voxelpipe
