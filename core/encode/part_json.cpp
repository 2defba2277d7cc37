#include "encode/part_json.h"

#include "base/text.h"

namespace voxelpipe {

using nlohmann::ordered_json;

ordered_json PartsJson(const PartTable& parts) {
  ordered_json json;
  json["label"] = parts.label;
  json["priority"] = parts.priority;
  json["triangles"] = parts.triangles;
  if (!parts.voxels.empty()) {
    json["open_edges"] = parts.open_edges;
    json["odd_columns"] = parts.odd_columns;
    json["voxels"] = parts.voxels;
  }
  json["name"] = ordered_json::array();
  for (size_t i = 0; i < parts.size(); ++i) json["name"].push_back(std::string(parts.Name(i)));
  return json;
}

uint64_t PartsJsonBytes(const PartShape& shape) {
  // Of a part: values of the document, the text of its numbers, and more while lists and texts grow. A byte of a name
  // is at most six of the text, "\u0001", and there are two texts.
  constexpr uint64_t kEach = 256, kOfName = 16;
  return shape.parts * kEach + shape.name_bytes * kOfName;
}

std::string JsonTextOf(const ordered_json& json, int indent) {
  return EscapeControls(json.dump(indent, ' ', false, ordered_json::error_handler_t::replace));
}

}  // namespace voxelpipe
