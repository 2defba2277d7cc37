// NanoVDB files: a fog volume "density", and a grid of each target that is not bits.
//
// Source: K. Museth, "NanoVDB: A GPU-Friendly and Portable VDB Data Structure For Real-Time Rendering And Simulation",
// SIGGRAPH Talks 2021; the file format is that of its header-only library, which writes it here. Integer coordinates
// are the centres of voxels. Not compressed: some readers take nothing else.
#include <nanovdb/util/GridBuilder.h>
#include <nanovdb/util/IO.h>

#include <exception>
#include <new>
#include <sstream>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/drawn/whole_file.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

using Handle = nanovdb::GridHandle<nanovdb::HostBuffer>;

nanovdb::Map MapOf(const GridSpec& grid) {
  const Vec3d &h = grid.voxel_size, &o = grid.origin;
  const double scale[3][3] = {{h.x, 0, 0}, {0, h.y, 0}, {0, 0, h.z}};
  const double inverse[3][3] = {{1 / h.x, 0, 0}, {0, 1 / h.y, 0}, {0, 0, 1 / h.z}};
  nanovdb::Map map;
  map.set(scale, inverse, nanovdb::Vec3d(o.x + h.x / 2, o.y + h.y / 2, o.z + h.z / 2), 1.0);
  return map;
}

// Appends a grid of value(n) at the solid voxels n.
template <typename Value, typename ValueOf>
absl::Status AddGrid(const DrawnResult& drawn, const JobContext* job, const std::string& name, nanovdb::GridClass kind,
                     const ValueOf& value, std::vector<Handle>& grids) {
  nanovdb::GridBuilder<Value> builder(Value(0.0f), kind);
  auto accessor = builder.getAccessor();
  const absl::Status visited = VisitVoxels(drawn.volume, job, [&](int64_t i, int64_t j, int64_t k, uint64_t n) {
    accessor.setValue(nanovdb::Coord(int(i), int(j), int(k)), value(n));
  });
  if (visited.ok()) grids.push_back(builder.getHandle(MapOf(drawn.result.grid), name));
  return visited;
}

absl::Status AddTarget(const DrawnResult& drawn, const JobContext* job, const PreviewItems& items, size_t target,
                       std::vector<Handle>& grids) {
  const TargetSpec& spec = drawn.result.specs[target];
  const TargetValues values(drawn.result, target, items.count());
  const std::string name = absl::StrCat("target", target);
  // Colours as fractions, as readers want them.
  const float unit = spec.format == VoxelFormat::kU8 && spec.components >= 3 ? 1 / 255.0f : 1;
  const auto number = [&](uint64_t n, int c) { return values.At(items.Find(n), c) * unit; };
  int first = 0;  // of the components that have grids of their own
  absl::Status s;
  if (spec.components >= 3) {
    const auto vector = [&](uint64_t n) { return nanovdb::Vec3f(number(n, 0), number(n, 1), number(n, 2)); };
    s = AddGrid<nanovdb::Vec3f>(drawn, job, name, nanovdb::GridClass::Unknown, vector, grids);
    first = 3;
  }
  for (int c = first; c < spec.components && s.ok(); ++c) {
    const std::string own = spec.components == 1 ? name : absl::StrCat(name, "_", c);
    const auto scalar = [&](uint64_t n) { return number(n, c); };
    s = AddGrid<float>(drawn, job, own, nanovdb::GridClass::Unknown, scalar, grids);
  }
  return s;
}

uint64_t NumbersOf(const VoxelizeResult& result) {
  uint64_t numbers = 0;
  for (const TargetSpec& spec : result.specs) {
    if (spec.format != VoxelFormat::kBit) numbers += uint64_t(spec.components);
  }
  return numbers;
}

absl::Status Encode(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  // The tree of a grid, and the grid made of it: leaves have 512 values, so that a lone voxel costs much.
  constexpr uint64_t kVoxelBytes = 64;
  const uint64_t numbers = 1 + NumbersOf(drawn.result);
  if (absl::Status s = drawn.memory.Grow(CountSolid(drawn.volume), kVoxelBytes * numbers, "grids:"); !s.ok()) return s;
  std::vector<Handle> grids;
  const auto solid = [](uint64_t) { return 1.0f; };
  absl::Status s = AddGrid<float>(drawn, job, "density", nanovdb::GridClass::FogVolume, solid, grids);
  const PreviewItems items(drawn.result);
  for (size_t t = 0; t < drawn.result.specs.size() && s.ok(); ++t) {
    if (drawn.result.specs[t].format != VoxelFormat::kBit) s = AddTarget(drawn, job, items, t, grids);
  }
  if (!s.ok()) return s;
  nanovdb::io::Segment segment(nanovdb::io::Codec::NONE);
  for (size_t g = 0; g < grids.size(); ++g) {
    segment.add(grids[g]);
    segment.meta[g].fileSize = grids[g].size();
  }
  std::ostringstream head;
  segment.write(head);
  const std::string text = head.str();
  s = file.Write({reinterpret_cast<const uint8_t*>(text.data()), text.size()}, job);
  for (size_t g = 0; g < grids.size() && s.ok(); ++g) s = file.Write({grids[g].data(), grids[g].size()}, job);
  return s;
}

absl::Status EncodeNvdb(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  try {
    return Encode(drawn, file, job);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat(".nvdb: ", error.what()));
  }
}

}  // namespace

std::unique_ptr<ResultFile> MakeNvdbFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".nvdb", path, job, &EncodeNvdb);
}

}  // namespace voxelpipe
