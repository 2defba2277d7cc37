#include "encode/formats/nrrd_header.h"

#include "absl/strings/str_cat.h"
#include "encode/formats/bytes.h"
#include "encode/formats/plain_elements.h"

namespace voxelpipe {
namespace {

std::string_view NrrdName(ElementType type) {
  switch (PlainTypeOf(type)) {
    case ElementType::kU16: return "uint16";
    case ElementType::kU32: return "uint32";
    case ElementType::kF32: return "float";
    default: return "uint8";
  }
}

}  // namespace

// Sizes are those of the file, the fastest first. The components of a vector are an axis of its own without a place:
// the fastest if interleaved, the slowest if planar.
std::string NrrdFields(const ResultHeader& header) {
  const GridSpec& grid = header.grid;
  const int components = header.specs[0].components;
  const bool first = components > 1 && header.layout == Layout::kInterleaved;
  const bool last = components > 1 && !first;
  const auto axes = [&](const std::string& of_components, const std::string& of_space) {
    return absl::StrCat(first ? of_components + " " : "", of_space, last ? " " + of_components : "", "\n");
  };
  const auto vector = [](double x, double y, double z) {
    return absl::StrCat("(", Shortest(x), ",", Shortest(y), ",", Shortest(z), ")");
  };
  const Vec3d &h = grid.voxel_size, &o = grid.origin;
  return absl::StrCat("NRRD0004\n# voxelpipe\ntype: ", std::string(NrrdName(header.arrays[0].type)),
                      "\ndimension: ", components > 1 ? 4 : 3, "\nspace: right-anterior-superior\nsizes: ",
                      axes(absl::StrCat(components), absl::StrCat(grid.dims[0], " ", grid.dims[1], " ", grid.dims[2])),
                      "space directions: ",
                      axes("none", absl::StrCat(vector(h.x, 0, 0), " ", vector(0, h.y, 0), " ", vector(0, 0, h.z))),
                      "centerings: ", axes("none", "cell cell cell"), "kinds: ", axes("vector", "domain domain domain"),
                      "endian: little\nencoding: gzip\nspace origin: ",  // the centre of the first voxel
                      vector(o.x + h.x / 2, o.y + h.y / 2, o.z + h.z / 2), "\n");
}

}  // namespace voxelpipe
