#include "job/result.h"

#include <bit>
#include <cstring>
#include <new>
#include <numeric>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMaskBytes = 64;

// The shape of a target's array: `items` are the grid's dims, or the number of listed voxels or fragments.
std::vector<uint64_t> TargetShape(const TargetSpec& spec, Layout layout, std::vector<uint64_t> items) {
  if (spec.components > 1) {
    items.insert(layout == Layout::kPlanar ? items.begin() : items.end(), uint64_t(spec.components));
  }
  return items;
}

// The lists and the targets.
std::vector<HostBuffer*> BuffersOf(VoxelizeResult& result) {
  std::vector<HostBuffer*> arrays;
  if (result.kind == ResultKind::kSparse) arrays = {&result.bricks, &result.masks};
  if (result.kind == ResultKind::kBuckets) arrays = {&result.voxels, &result.offsets, &result.triangles};
  for (HostBuffer& target : result.targets) arrays.push_back(&target);
  return arrays;
}

void AddParts(const PartShape& parts, std::vector<ArraySpec>& arrays) {
  if (parts.parts == 0) return;
  const auto add = [&](const char* name, ElementType type) { arrays.push_back({name, type, {parts.parts}}); };
  add("part_label", ElementType::kU32);
  add("part_priority", ElementType::kI32);
  add("part_triangles", ElementType::kU64);
  if (parts.filled) {
    add("part_open_edges", ElementType::kU64);
    add("part_odd_columns", ElementType::kU64);
    add("part_voxels", ElementType::kU64);
  }
  arrays.push_back({"part_name_offset", ElementType::kU64, {parts.parts + 1}});
  arrays.push_back({"part_name", ElementType::kU8, {parts.name_bytes}});
}

}  // namespace

std::string_view Name(ResultKind kind) {
  switch (kind) {
    case ResultKind::kDense: return "dense";
    case ResultKind::kSparse: return "sparse";
    case ResultKind::kBuckets: return "buckets";
  }
  return "unknown";
}

std::string_view Name(ElementType type) {
  switch (type) {
    case ElementType::kBit: return "bit";
    case ElementType::kU8: return "u8";
    case ElementType::kU16: return "u16";
    case ElementType::kU32: return "u32";
    case ElementType::kU64: return "u64";
    case ElementType::kF16: return "f16";
    case ElementType::kF32: return "f32";
    case ElementType::kI32: return "i32";
  }
  return "unknown";
}

ElementType ElementOf(VoxelFormat format) {
  switch (format) {
    case VoxelFormat::kBit: return ElementType::kBit;
    case VoxelFormat::kU8:
    case VoxelFormat::kU8Srgb:
    case VoxelFormat::kU8Snorm: return ElementType::kU8;
    case VoxelFormat::kU16:
    case VoxelFormat::kU16Snorm: return ElementType::kU16;
    case VoxelFormat::kU32: return ElementType::kU32;
    case VoxelFormat::kF16: return ElementType::kF16;
    case VoxelFormat::kF32: return ElementType::kF32;
  }
  return ElementType::kU8;
}

uint64_t ArrayBytes(ElementType type, uint64_t count) {
  switch (type) {
    case ElementType::kBit: return count / 8 + (count % 8 != 0);
    case ElementType::kU8: return count;
    case ElementType::kU16:
    case ElementType::kF16: return count * 2;
    case ElementType::kU32:
    case ElementType::kF32:
    case ElementType::kI32: return count * 4;
    case ElementType::kU64: return count * 8;
  }
  return 0;
}

uint64_t ArraySpec::bytes() const {
  return ArrayBytes(type, std::accumulate(shape.begin(), shape.end(), uint64_t{1}, std::multiplies<>()));
}

uint64_t VoxelizeResult::listed_voxels() const {
  if (kind == ResultKind::kDense) return grid.voxels();
  if (kind == ResultKind::kBuckets) return voxels.size() / sizeof(uint64_t);
  uint64_t count = 0;
  for (uint64_t i = 0; i < masks.size(); i += sizeof(uint64_t)) {
    uint64_t word;
    std::memcpy(&word, masks.data() + i, sizeof word);
    count += uint64_t(std::popcount(word));
  }
  return count;
}

PartShape ResultHeader::parts() const {
  const size_t first = first_part_array();
  if (arrays.size() <= first) return {};
  constexpr size_t kWithoutFill = 5;
  return {arrays[first].shape[0], arrays.size() > first + kWithoutFill, arrays.back().shape[0]};
}

ResultHeader MakeResultHeader(const VoxelizeRequest& request, const GridSpec& grid, uint64_t bricks, uint64_t voxels,
                              uint64_t fragments, const PartShape& parts) {
  ResultHeader header;
  header.kind = request.result;
  header.grid = grid;
  header.layout = request.layout;
  header.specs = request.targets;
  std::vector<uint64_t> items;
  switch (request.result) {
    case ResultKind::kDense: items = {uint64_t(grid.dims[2]), uint64_t(grid.dims[1]), uint64_t(grid.dims[0])}; break;
    case ResultKind::kSparse:
      header.arrays.push_back({"brick", ElementType::kU64, {bricks}});
      header.arrays.push_back({"mask", ElementType::kU8, {bricks, kMaskBytes}});
      items = {voxels};
      break;
    case ResultKind::kBuckets:
      header.arrays.push_back({"voxel", ElementType::kU64, {voxels}});
      header.arrays.push_back({"offset", ElementType::kU64, {voxels + 1}});
      header.arrays.push_back({"triangle", ElementType::kU32, {fragments}});
      items = {fragments};
      break;
  }
  for (size_t i = 0; i < request.targets.size(); ++i) {
    const TargetSpec& spec = request.targets[i];
    header.arrays.push_back(
        {absl::StrCat("target", i), ElementOf(spec.format), TargetShape(spec, request.layout, items)});
  }
  AddParts(parts, header.arrays);
  return header;
}

ResultHeader DenseHeader(const VoxelizeRequest& request, const GridSpec& grid, const PartShape& parts) {
  return MakeResultHeader(request, grid, 0, 0, 0, parts);
}

uint64_t BytesOf(const ResultHeader& header) {
  uint64_t bytes = 0;
  for (const ArraySpec& array : header.arrays) bytes += array.bytes();
  return bytes;
}

ResultHeader HeaderOf(const VoxelizeResult& result) {
  VoxelizeRequest request;
  request.result = result.kind;
  request.layout = result.layout;
  request.targets = result.specs;
  return MakeResultHeader(request, result.grid, result.listed_bricks(), result.listed_voxels(),
                          result.listed_fragments(), result.parts.shape());
}

std::vector<std::span<uint8_t>> MutableArraysOf(VoxelizeResult& result) {
  std::vector<std::span<uint8_t>> arrays;
  for (HostBuffer* const array : BuffersOf(result)) arrays.push_back(array->bytes());
  for (const std::span<uint8_t> array : ArraysOf(result.parts)) arrays.push_back(array);
  return arrays;
}

std::vector<std::span<const uint8_t>> ArraysOf(const VoxelizeResult& result) {
  const std::vector<std::span<uint8_t>> arrays = MutableArraysOf(const_cast<VoxelizeResult&>(result));
  return {arrays.begin(), arrays.end()};
}

absl::StatusOr<VoxelizeResult> AllocateResult(const ResultHeader& header) {
  VoxelizeResult result;
  result.kind = header.kind;
  result.grid = header.grid;
  result.layout = header.layout;
  result.specs = header.specs;
  result.targets.resize(header.specs.size());
  try {
    result.parts = MakePartTable(header.parts());
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the table of parts");
  }
  const std::vector<HostBuffer*> arrays = BuffersOf(result);
  for (size_t i = 0; i < arrays.size(); ++i) {
    absl::StatusOr<HostBuffer> buffer = HostBuffer::Allocate(header.arrays[i].bytes());
    if (!buffer.ok()) return buffer.status();
    *arrays[i] = *std::move(buffer);
  }
  return result;
}

absl::Status WriteTo(const VoxelizeResult& result, ResultSink& sink) {
  if (absl::Status s = sink.Begin(HeaderOf(result)); !s.ok()) return s;
  const std::vector<std::span<const uint8_t>> arrays = ArraysOf(result);
  for (size_t i = 0; i < arrays.size(); ++i) {
    if (arrays[i].empty()) continue;
    if (absl::Status s = sink.Write(i, arrays[i]); !s.ok()) return s;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
