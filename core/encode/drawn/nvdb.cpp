// NanoVDB files: the grids of vdb_grids.h.
//
// Source: K. Museth, "NanoVDB: A GPU-Friendly and Portable VDB Data Structure For Real-Time Rendering And Simulation",
// SIGGRAPH Talks 2021; the file format is that of its header-only library, which writes it here. Not compressed: some
// readers take nothing else.
#include <nanovdb/util/GridBuilder.h>
#include <nanovdb/util/IO.h>

#include <exception>
#include <new>
#include <sstream>
#include <vector>

#include "encode/drawn/vdb_grids.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

using Handle = nanovdb::GridHandle<nanovdb::HostBuffer>;

nanovdb::Map MapOf(const GridSpec& grid) {
  const Vec3d &h = grid.voxel_size, first = FirstCentre(grid);
  const double scale[3][3] = {{h.x, 0, 0}, {0, h.y, 0}, {0, 0, h.z}};
  const double inverse[3][3] = {{1 / h.x, 0, 0}, {0, 1 / h.y, 0}, {0, 0, 1 / h.z}};
  nanovdb::Map map;
  map.set(scale, inverse, nanovdb::Vec3d(first.x, first.y, first.z), 1.0);
  return map;
}

// What GridBuilder takes for the tree of a grid, with the allocator's share.
template <typename Value>
uint64_t BuilderBytes(const VdbNodes& nodes) {
  constexpr uint64_t kNode = 64;  // place, offset, the list of nodes, the allocator
  constexpr uint64_t kEntry = (sizeof(Value) + sizeof(void*) - 1) / sizeof(void*) * sizeof(void*);
  constexpr uint64_t kLeaf = 512 * sizeof(Value) + 512 / 8, kLower = 4096 * kEntry + 2 * 4096 / 8,
                     kUpper = 32768 * kEntry + 2 * 32768 / 8;
  return nodes.leaves * (kLeaf + kNode) + nodes.lower * (kLower + kNode) + nodes.upper * (kUpper + kNode);
}

// The grid that is made of it.
template <typename Value>
uint64_t GridBytes(const VdbNodes& nodes) {
  constexpr uint64_t kHead = 4096, kRootEntry = 64;
  return kHead + nodes.leaves * sizeof(nanovdb::NanoLeaf<Value>) + nodes.lower * sizeof(nanovdb::NanoLower<Value>) +
         nodes.upper * (sizeof(nanovdb::NanoUpper<Value>) + kRootEntry);
}

class NanoGrids {
 public:
  NanoGrids(const DrawnResult& drawn, const VdbNodes& nodes, const JobContext* job)
      : drawn_(drawn), nodes_(nodes), job_(job) {}

  template <typename ValueOf>
  absl::Status AddFog(const std::string& name, const ValueOf& value) {
    return Add<float>(name, nanovdb::GridClass::FogVolume, value);
  }
  template <typename ValueOf>
  absl::Status AddScalar(const std::string& name, const ValueOf& value) {
    return Add<float>(name, nanovdb::GridClass::Unknown, value);
  }
  template <typename ValueOf>
  absl::Status AddVector(const std::string& name, const ValueOf& value) {
    return Add<nanovdb::Vec3f>(name, nanovdb::GridClass::Unknown, [&](uint64_t n) {
      const std::array<float, 3> v = value(n);
      return nanovdb::Vec3f(v[0], v[1], v[2]);
    });
  }

  const std::vector<Handle>& handles() const { return handles_; }

 private:
  template <typename Value, typename ValueOf>
  absl::Status Add(const std::string& name, nanovdb::GridClass kind, const ValueOf& value) {
    MemoryCharge builder_memory(&MemoryOf(job_));
    if (absl::Status s = builder_memory.Grow(BuilderBytes<Value>(nodes_), "a grid:"); !s.ok()) return s;
    if (absl::Status s = drawn_.memory.Grow(GridBytes<Value>(nodes_), "a grid:"); !s.ok()) return s;
    nanovdb::GridBuilder<Value> builder(Value(0.0f), kind);
    auto accessor = builder.getAccessor();
    const absl::Status visited = VisitVoxels(drawn_.volume, job_, [&](int64_t i, int64_t j, int64_t k, uint64_t n) {
      accessor.setValue(nanovdb::Coord(int(i), int(j), int(k)), value(n));
    });
    // The library's own loops do not look at the job: they copy the tree once.
    if (visited.ok()) handles_.push_back(builder.getHandle(MapOf(drawn_.result.grid), name));
    return visited;
  }

  const DrawnResult& drawn_;
  const VdbNodes nodes_;
  const JobContext* job_;
  std::vector<Handle> handles_;
};

absl::Status Encode(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  const absl::StatusOr<VdbNodes> nodes = CountNodes(drawn.volume, job);
  if (!nodes.ok()) return nodes.status();
  NanoGrids grids(drawn, *nodes, job);
  if (absl::Status s = AddGrids(drawn, grids); !s.ok()) return s;
  nanovdb::io::Segment segment(nanovdb::io::Codec::NONE);
  for (const Handle& handle : grids.handles()) {
    segment.add(handle);
    segment.meta.back().fileSize = handle.size();
  }
  std::ostringstream head;
  segment.write(head);
  const std::string text = head.str();
  absl::Status s = file.Write({reinterpret_cast<const uint8_t*>(text.data()), text.size()}, job);
  for (const Handle& handle : grids.handles()) {
    if (s.ok()) s = file.Write({handle.data(), handle.size()}, job);
  }
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
