// OpenVDB files: the grids of vdb_grids.h. The fog volume comes first, as Blender and Unreal Engine want it.
//
// Source: K. Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", ACM Transactions on Graphics 32(3),
// 2013; OpenVDB's library writes the file.
#include <openvdb/io/Archive.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Prune.h>

#include <exception>
#include <new>
#include <sstream>

#include "absl/strings/str_format.h"
#include "base/checksum/crc32c.h"
#include "encode/drawn/vdb_grids.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

openvdb::math::Transform::Ptr TransformOf(const GridSpec& grid) {
  const Vec3d &h = grid.voxel_size, first = FirstCentre(grid);
  openvdb::math::Mat4d to_world = openvdb::math::Mat4d::identity();
  to_world.setToScale(openvdb::Vec3d(h.x, h.y, h.z));
  to_world.setTranslation(openvdb::Vec3d(first.x, first.y, first.z));
  return openvdb::math::Transform::createLinearTransform(to_world);
}

class OpenGrids {
 public:
  OpenGrids(const DrawnResult& drawn, const VdbNodes& nodes, const JobContext* job)
      : drawn_(drawn), nodes_(nodes), job_(job) {}

  template <typename ValueOf>
  absl::Status AddFog(const std::string& name, const ValueOf& value) {
    absl::Status visited = Add<openvdb::FloatGrid>(name, value);
    if (!visited.ok()) return visited;
    grids_.back()->setGridClass(openvdb::GRID_FOG_VOLUME);
    openvdb::tools::prune(openvdb::gridPtrCast<openvdb::FloatGrid>(grids_.back())->tree());  // solids become tiles
    return visited;
  }
  template <typename ValueOf>
  absl::Status AddScalar(const std::string& name, const ValueOf& value) {
    return Add<openvdb::FloatGrid>(name, value);
  }
  template <typename ValueOf>
  absl::Status AddVector(const std::string& name, const ValueOf& value) {
    return Add<openvdb::Vec3SGrid>(name, [&](uint64_t n) { return openvdb::Vec3f(value(n).data()); });
  }

  openvdb::GridCPtrVec grids() const { return {grids_.begin(), grids_.end()}; }

 private:
  template <typename Grid, typename ValueOf>
  absl::Status Add(const std::string& name, const ValueOf& value) {
    // The tree, and its part of the file.
    constexpr uint64_t kNode = 256, kValue = sizeof(typename Grid::ValueType);
    constexpr uint64_t kEntry = (kValue + sizeof(void*) - 1) / sizeof(void*) * sizeof(void*);
    const uint64_t tree = nodes_.leaves * (512 * kValue + kNode) + nodes_.lower * (4096 * kEntry + 1024 + kNode) +
                          nodes_.upper * (32768 * kEntry + 8192 + kNode);
    if (absl::Status s = drawn_.memory.Grow(2 * tree, "a grid:"); !s.ok()) return s;
    const auto grid = Grid::create();
    grid->setName(name);
    grid->setTransform(TransformOf(drawn_.result.grid));
    auto accessor = grid->getAccessor();
    absl::Status visited = VisitVoxels(drawn_.volume, job_, [&](int64_t i, int64_t j, int64_t k, uint64_t n) {
      accessor.setValueOn(openvdb::Coord(int(i), int(j), int(k)), value(n));
    });
    if (visited.ok()) grids_.push_back(grid);
    return visited;
  }

  const DrawnResult& drawn_;
  const VdbNodes nodes_;
  const JobContext* job_;
  std::vector<openvdb::GridBase::Ptr> grids_;
};

// Files have the offsets of their grids, which only a stream that can seek gets.
class SeekableArchive : public openvdb::io::Archive {
 public:
  void Write(std::ostream& out, const openvdb::GridCPtrVec& grids) const { write(out, grids, /*seekable=*/true); }
};

// The library writes a random tag in the form of a UUID, by which programs tell files apart. Made of the contents
// instead, so that the same result has the same bytes.
void SetTag(std::string& file) {
  constexpr size_t kTagAt = 8 + 4 + 4 + 4 + 1;  // after magic, versions of file and library, and a flag
  constexpr size_t kTagBytes = 36;
  const std::span<uint8_t> bytes(reinterpret_cast<uint8_t*>(file.data()), file.size());
  const uint32_t contents = Crc32c(bytes.subspan(kTagAt + kTagBytes));
  file.replace(kTagAt, kTagBytes, absl::StrFormat("%08x-0000-8000-8000-000000000000", contents));
}

absl::Status Encode(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  const absl::StatusOr<VdbNodes> nodes = CountNodes(drawn.volume, job);
  if (!nodes.ok()) return nodes.status();
  openvdb::initialize();
  OpenGrids grids(drawn, *nodes, job);
  if (absl::Status s = AddGrids(drawn, grids); !s.ok()) return s;
  std::ostringstream out(std::ios::binary);
  SeekableArchive().Write(out, grids.grids());
  std::string bytes = std::move(out).str();
  SetTag(bytes);
  return file.Write({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}, job);
}

absl::Status EncodeVdb(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  try {
    return Encode(drawn, file, job);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat(".vdb: ", error.what()));
  }
}

}  // namespace

std::unique_ptr<ResultFile> MakeVdbFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".vdb", path, job, &EncodeVdb);
}

}  // namespace voxelpipe
