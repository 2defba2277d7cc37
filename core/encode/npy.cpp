// Source: "NEP 1: A Simple File Format for NumPy Arrays", R. Kern, 2007, and numpy/lib/format.py for version 2.0.
#include "encode/npy.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

static_assert(std::endian::native == std::endian::little, "targets are written as they lie in memory");

// The eight bits of each byte value as eight bytes 0/1, lowest first.
constexpr auto kExpanded = [] {
  std::array<std::array<uint8_t, 8>, 256> table{};
  for (int value = 0; value < 256; ++value) {
    for (int bit = 0; bit < 8; ++bit) table[value][bit] = uint8_t((value >> bit) & 1);
  }
  return table;
}();

absl::Status WriteBits(std::span<const uint8_t> bits, uint64_t voxels, AtomicFile& file, const JobContext* job) {
  constexpr uint64_t kPieceVoxels = uint64_t{4} << 20;
  std::vector<uint8_t> piece(std::min(voxels, kPieceVoxels) + 8);
  for (uint64_t begin = 0; begin < voxels; begin += kPieceVoxels) {
    const uint64_t count = std::min(kPieceVoxels, voxels - begin);
    for (uint64_t n = 0; n < count; n += 8) std::memcpy(&piece[n], kExpanded[bits[(begin + n) / 8]].data(), 8);
    if (absl::Status status = file.Write({piece.data(), count}, job); !status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace

std::string NpyHeader(std::string_view descr, const std::vector<uint64_t>& shape) {
  std::string dictionary = absl::StrCat("{'descr': '", std::string(descr), "', 'fortran_order': False, 'shape': (");
  for (size_t i = 0; i < shape.size(); ++i) absl::StrAppend(&dictionary, i > 0 ? ", " : "", shape[i]);
  // A tuple of one needs its comma.
  absl::StrAppend(&dictionary, shape.size() == 1 ? ",), }" : "), }");

  constexpr size_t kAlignment = 64;
  const auto padded = [&](size_t prefix) {  // dictionary and newline, so that prefix + result is aligned
    return (prefix + dictionary.size() + 1 + kAlignment - 1) / kAlignment * kAlignment - prefix;
  };
  const bool version1 = padded(10) <= 0xffff;
  const size_t length = padded(version1 ? 10 : 12);
  std::string header("\x93NUMPY", 6);
  header += version1 ? '\x01' : '\x02';
  header += '\x00';
  for (int byte = 0; byte < (version1 ? 2 : 4); ++byte) header += char((length >> (8 * byte)) & 0xff);
  header += dictionary;
  header.append(length - dictionary.size() - 1, ' ');
  header += '\n';
  return header;
}

std::vector<uint64_t> NpyShape(const GridSpec& grid, const TargetSpec& target, Layout layout) {
  std::vector<uint64_t> shape{uint64_t(grid.dims[2]), uint64_t(grid.dims[1]), uint64_t(grid.dims[0])};
  if (target.components > 1) {
    shape.insert(layout == Layout::kPlanar ? shape.begin() : shape.end(), uint64_t(target.components));
  }
  return shape;
}

absl::Status WriteNpy(const VoxelizeResult& result, size_t index, AtomicFile& file, const JobContext* job) {
  const TargetSpec& target = result.specs[index];
  const bool is_bit = target.format == VoxelFormat::kBit;
  const std::string header = NpyHeader(is_bit ? "|u1" : "<f4", NpyShape(result.grid, target, result.layout));
  const auto* bytes = reinterpret_cast<const uint8_t*>(header.data());
  if (absl::Status status = file.Write({bytes, header.size()}, job); !status.ok()) return status;
  if (is_bit) return WriteBits(result.targets[index].bytes(), result.grid.voxels(), file, job);
  return file.Write(result.targets[index].bytes(), job);
}

}  // namespace voxelpipe
