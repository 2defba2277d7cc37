// The parts of a result: sets of triangles that bound a solid of their own (mesh/parts/part_list.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"

namespace voxelpipe {

// What decides the sizes of the arrays of a PartTable.
struct PartShape {
  uint64_t parts = 0;       // 0: the request does not cut the mesh into parts, and there are no arrays
  bool filled = false;      // `open_edges`, `odd_columns` and `voxels` are there
  uint64_t name_bytes = 0;  // of all names together
  uint64_t bytes() const;   // of all arrays
  friend bool operator==(const PartShape&, const PartShape&) = default;
};

// Structure of arrays: one element a part, by its number. Empty where the request does not cut the mesh into parts.
struct PartTable {
  std::vector<uint32_t> label;
  std::vector<int32_t> priority;
  std::vector<uint64_t> triangles;
  // Where parts are filled (FillsParts); else empty.
  std::vector<uint64_t> open_edges;   // used by an odd number of the part's triangles, after welding equal positions
  std::vector<uint64_t> odd_columns;  // lines along x that the fill leaves out for this part: it is open there
  // Voxels that the part owns: those with a fragment of the part (discarded ones too) or their centre inside of it, and
  // of no part of a higher rank.
  std::vector<uint64_t> voxels;
  // The name of part i is UTF-8: bytes [name_offset[i], name_offset[i + 1]) of `name`. Empty: it has none.
  std::vector<uint64_t> name_offset;
  std::vector<uint8_t> name;

  size_t size() const { return label.size(); }
  bool empty() const { return label.empty(); }
  PartShape shape() const { return {label.size(), !voxels.empty(), name.size()}; }
  std::string_view Name(size_t part) const {
    return {reinterpret_cast<const char*>(name.data()) + name_offset[part],
            size_t(name_offset[part + 1] - name_offset[part])};
  }
  uint64_t bytes() const { return shape().bytes(); }
};

// A table of arrays of these sizes, all 0.
PartTable MakePartTable(const PartShape& shape);

// The bytes of the arrays that a table of this shape has, in the order of ResultHeader::arrays.
std::vector<std::span<uint8_t>> ArraysOf(PartTable& table);

// In: a table from elsewhere, of a shape that it was made with. DATA_LOSS naming array and entry if names do not follow
// each other, or a label is 0.
absl::Status CheckParts(const PartTable& table);

}  // namespace voxelpipe
