#include "job/part_table.h"

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

template <typename Element>
std::span<uint8_t> BytesOf(std::vector<Element>& array) {
  return {reinterpret_cast<uint8_t*>(array.data()), array.size() * sizeof(Element)};
}

}  // namespace

uint64_t PartShape::bytes() const {
  if (parts == 0) return 0;
  const uint64_t counts = filled ? 4 : 1;
  return parts * (2 * sizeof(uint32_t) + counts * sizeof(uint64_t)) + (parts + 1) * sizeof(uint64_t) + name_bytes;
}

PartTable MakePartTable(const PartShape& shape) {
  PartTable table;
  if (shape.parts == 0) return table;
  table.label.resize(shape.parts);
  table.priority.resize(shape.parts);
  table.triangles.resize(shape.parts);
  const uint64_t filled = shape.filled ? shape.parts : 0;
  table.open_edges.resize(filled);
  table.odd_columns.resize(filled);
  table.voxels.resize(filled);
  table.name_offset.resize(shape.parts + 1);
  table.name.resize(shape.name_bytes);
  return table;
}

std::vector<std::span<uint8_t>> ArraysOf(PartTable& table) {
  if (table.empty()) return {};
  std::vector<std::span<uint8_t>> arrays = {BytesOf(table.label), BytesOf(table.priority), BytesOf(table.triangles)};
  if (!table.voxels.empty()) {
    for (auto* const counts : {&table.open_edges, &table.odd_columns, &table.voxels})
      arrays.push_back(BytesOf(*counts));
  }
  arrays.push_back(BytesOf(table.name_offset));
  arrays.push_back(BytesOf(table.name));
  return arrays;
}

absl::Status CheckParts(const PartTable& table) {
  for (size_t i = 0; i < table.label.size(); ++i) {
    if (table.label[i] == 0) return absl::DataLossError(absl::StrCat("part_label[", i, "] is 0"));
  }
  uint64_t begin = 0;
  for (size_t i = 0; i < table.name_offset.size(); ++i) {
    const uint64_t end = table.name_offset[i];
    if (end < begin || end > table.name.size() || (i == 0 && end != 0)) {
      return absl::DataLossError(
          absl::StrCat("part_name_offset[", i, "] is ", end, " after ", begin, ", of ", table.name.size(), " bytes"));
    }
    begin = end;
  }
  if (begin != table.name.size()) {
    return absl::DataLossError(absl::StrCat("the names of parts end at ", begin, " of ", table.name.size(), " bytes"));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
