#include "reply/list_check.h"

#include <array>
#include <cstring>
#include <string>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr int64_t kBrick = 8;
constexpr uint64_t kMaskBytes = 64;

template <typename... Parts>
absl::Status Lost(const Parts&... parts) {
  return absl::DataLossError(absl::StrCat("the server's result: ", parts...));
}

template <typename T>
T At(const HostBuffer& buffer, uint64_t i) {
  T value;
  std::memcpy(&value, buffer.data() + i * sizeof(T), sizeof value);
  return value;
}

// Ids ascend strictly and stay below `end`.
absl::Status CheckIds(const HostBuffer& ids, const char* name, uint64_t end) {
  uint64_t least = 0;
  for (uint64_t i = 0; i < ids.size() / sizeof(uint64_t); ++i) {
    const uint64_t id = At<uint64_t>(ids, i);
    if (id < least) return Lost(name, "[", i, "] is ", id, ", which does not ascend");
    if (id >= end) return Lost(name, "[", i, "] is ", id, ", the grid has ", end);
    least = id + 1;
  }
  return absl::OkStatus();
}

absl::Status CheckSparse(const VoxelizeResult& result, const std::vector<ArraySpec>& announced) {
  std::array<uint64_t, 3> bricks;
  for (size_t a = 0; a < 3; ++a) bricks[a] = uint64_t((result.grid.dims[a] + kBrick - 1) / kBrick);
  absl::Status s = CheckIds(result.bricks, "brick", bricks[0] * bricks[1] * bricks[2]);
  if (!s.ok()) return s;
  for (uint64_t i = 0; i < result.listed_bricks(); ++i) {
    const uint64_t id = At<uint64_t>(result.bricks, i);
    const std::array<uint64_t, 3> at = {id % bricks[0], id / bricks[0] % bricks[1], id / bricks[0] / bricks[1]};
    int64_t left[3];  // voxels of the grid from the brick's corner on
    for (size_t a = 0; a < 3; ++a) left[a] = result.grid.dims[a] - int64_t(at[a]) * kBrick;
    uint8_t any = 0;
    for (int64_t z = 0; z < kBrick; ++z) {
      for (int64_t y = 0; y < kBrick; ++y) {
        const uint8_t row = result.masks.data()[i * kMaskBytes + uint64_t(y + kBrick * z)];
        const unsigned inside = z < left[2] && y < left[1] ? (left[0] >= kBrick ? 0xffu : (1u << left[0]) - 1) : 0u;
        if ((row & ~inside) != 0) return Lost("mask[", i, "] has voxels outside of the grid");
        any |= row;
      }
    }
    if (any == 0) return Lost("mask[", i, "] is empty");
  }
  if (HeaderOf(result).arrays != announced) {
    return Lost("the masks have ", result.listed_voxels(), " voxels, which is not the announced number of values");
  }
  return absl::OkStatus();
}

absl::Status CheckBuckets(const VoxelizeResult& result) {
  if (absl::Status s = CheckIds(result.voxels, "voxel", result.grid.voxels()); !s.ok()) return s;
  const uint64_t voxels = result.listed_voxels(), fragments = result.listed_fragments();
  uint64_t begin = At<uint64_t>(result.offsets, 0);
  if (begin != 0) return Lost("offset[0] is ", begin);
  for (uint64_t i = 0; i < voxels; ++i) {
    const uint64_t end = At<uint64_t>(result.offsets, i + 1);
    if (end <= begin || end > fragments) return Lost("offset[", i + 1, "] is ", end, " after ", begin);
    for (uint64_t f = begin + 1; f < end; ++f) {
      if (At<uint32_t>(result.triangles, f) <= At<uint32_t>(result.triangles, f - 1)) {
        return Lost("triangle[", f, "] does not ascend within its voxel");
      }
    }
    begin = end;
  }
  if (begin != fragments) return Lost("the offsets end at ", begin, " of ", fragments, " fragments");
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckTable(const PartTable& parts) {
  const absl::Status s = CheckParts(parts);
  return s.ok() ? s : Lost(std::string(s.message()));
}

absl::Status CheckLists(const VoxelizeResult& result, const std::vector<ArraySpec>& announced) {
  if (absl::Status s = CheckTable(result.parts); !s.ok()) return s;
  switch (result.kind) {
    case ResultKind::kDense: return absl::OkStatus();
    case ResultKind::kSparse: return CheckSparse(result, announced);
    case ResultKind::kBuckets: return CheckBuckets(result);
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
