#include "gpu/parity/first_difference.h"

#include <cstring>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace voxelpipe::gpu {
namespace {

// Element `i` as its bits.
uint64_t ElementAt(ElementType type, const std::vector<uint8_t>& bytes, uint64_t i) {
  if (type == ElementType::kBit) return (bytes[i / 8] >> (i % 8)) & 1;
  const uint64_t width = ArrayBytes(type, 1);
  uint64_t value = 0;
  std::memcpy(&value, bytes.data() + i * width, width);
  return value;
}

std::string Show(ElementType type, uint64_t bits) {
  if (type != ElementType::kF32) return absl::StrCat("0x", absl::Hex(bits));
  float value;
  const auto low = uint32_t(bits);
  std::memcpy(&value, &low, sizeof value);
  return absl::StrCat(value, " (0x", absl::Hex(bits), ")");
}

// What the element is: the voxel and component of a dense target's, else its plain number, also in the table of parts.
std::string Place(const ResultHeader& header, const ArraySpec& array, uint64_t i) {
  if (header.kind != ResultKind::kDense) return absl::StrCat(array.name, "[", i, "]");
  const uint64_t voxels = header.grid.voxels();
  uint64_t elements = 1;
  for (const uint64_t n : array.shape) elements *= n;
  if (array.name.starts_with("part_")) return absl::StrCat(array.name, "[", i, "]");
  const uint64_t components = elements / voxels;
  const bool planar = header.layout == Layout::kPlanar;
  const uint64_t voxel = planar ? i % voxels : i / components, component = planar ? i / voxels : i % components;
  const auto nx = uint64_t(header.grid.dims[0]), ny = uint64_t(header.grid.dims[1]);
  return absl::StrCat(array.name, " voxel ", voxel % nx, ",", voxel / nx % ny, ",", voxel / nx / ny, " component ",
                      component);
}

std::optional<std::string> DifferentArray(const ResultHeader& header, const ArraySpec& array,
                                          const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
  if (a == b) return std::nullopt;
  if (a.size() != b.size()) return absl::StrCat(array.name, " has ", a.size(), " and ", b.size(), " bytes");
  uint64_t elements = 1;
  for (const uint64_t n : array.shape) elements *= n;
  uint64_t different = 0, first = 0;
  for (uint64_t i = 0; i < elements; ++i) {
    if (ElementAt(array.type, a, i) == ElementAt(array.type, b, i)) continue;
    if (different++ == 0) first = i;
  }
  if (different == 0) return absl::StrCat(array.name, " differs in its unused bits");
  return absl::StrCat(Place(header, array, first), ": ", Show(array.type, ElementAt(array.type, a, first)), " and ",
                      Show(array.type, ElementAt(array.type, b, first)), "; ", different, " of ", elements, " differ");
}

std::string Count(const std::optional<uint64_t>& count) {
  return count ? absl::StrCat(*count) : "none";
}

}  // namespace

std::optional<std::string> FirstDifference(const Delivered& a, const Delivered& b) {
  if (!(a.header.grid == b.header.grid)) return "another grid";
  if (a.header.arrays.size() != b.header.arrays.size() || a.arrays.size() != b.arrays.size())
    return absl::StrCat(a.arrays.size(), " and ", b.arrays.size(), " arrays");
  // A longer list comes first: what follows it differs too.
  for (size_t i = 0; i < a.header.arrays.size(); ++i) {
    const ArraySpec &x = a.header.arrays[i], &y = b.header.arrays[i];
    if (x == y) continue;
    return absl::StrCat(x.name, " has shape ", absl::StrJoin(x.shape, "x"), " and ", y.name, " ",
                        absl::StrJoin(y.shape, "x"));
  }
  for (size_t i = 0; i < a.arrays.size(); ++i) {
    if (auto difference = DifferentArray(a.header, a.header.arrays[i], a.arrays[i], b.arrays[i])) return difference;
  }
  if (a.stats.occupied != b.stats.occupied)
    return absl::StrCat("occupied: ", a.stats.occupied, " and ", b.stats.occupied);
  if (a.stats.triangles_outside != b.stats.triangles_outside)
    return absl::StrCat("triangles_outside: ", a.stats.triangles_outside, " and ", b.stats.triangles_outside);
  if (a.stats.odd_columns != b.stats.odd_columns)
    return absl::StrCat("odd_columns: ", Count(a.stats.odd_columns), " and ", Count(b.stats.odd_columns));
  if (a.stats.fragments && b.stats.fragments && *a.stats.fragments != *b.stats.fragments)
    return absl::StrCat("fragments: ", *a.stats.fragments, " and ", *b.stats.fragments);
  return std::nullopt;
}

}  // namespace voxelpipe::gpu
