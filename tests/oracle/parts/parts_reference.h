// Fills by parts from their definition, slowly and without code of the product's: parts, who contains which centre, who
// owns which voxel, and what targets then hold. The fragments and their values are those of the A-buffer.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "job/request.h"
#include "job/result.h"
#include "oracle/parts/assembly.h"

namespace voxelpipe::testing {

struct ReferencePart {
  std::string name;
  uint32_t label = 1;
  int64_t priority = 0;
  size_t rank = 0;
  std::vector<size_t> bodies;
};
struct ReferenceParts {
  std::vector<ReferencePart> parts;
  std::vector<size_t> of_body;
};
ReferenceParts CutParts(const Assembly& assembly, const PartSelection& selection);

enum class Inside : uint8_t { kNo, kYes, kUnsure };  // unsure: a face passes the centre within 1e-6 voxels

// Which centres the bodies of an assembly contain.
class Solids {
 public:
  Solids(const Assembly& assembly, const GridSpec& grid);
  // Of some bodies together, for each voxel. If all are closed, by winding numbers, otherwise by crossings.
  std::vector<Inside> Of(const std::vector<size_t>& bodies, Fill fill) const;
  // The same by crossings along x. Counts odd columns, and those beside an edge of an open
  // body, which may be odd.
  std::vector<Inside> ByCrossings(const std::vector<size_t>& bodies, Fill fill, uint64_t* odd = nullptr,
                                  uint64_t* maybe_odd = nullptr) const;

 private:
  void Wind(size_t body);

  const Assembly& assembly_;
  const GridSpec grid_;
  std::vector<std::vector<Vec3d>> positions_;  // index space
  std::vector<std::vector<int8_t>> winding_;   // of closed bodies, by voxel
  std::vector<std::vector<bool>> near_;
};

// The fragments of an assembly under a coverage, each with its stored values of the targets of a request.
class Fragments {
 public:
  Fragments(const Assembly& assembly, const VoxelizeRequest& request);
  // The triangles of a voxel, ascending.
  const std::vector<uint32_t>& Of(uint64_t voxel) const { return triangles_[voxel]; }
  // As stored, of fragment i of a voxel.
  uint32_t Value(uint64_t voxel, size_t i, size_t target, int c) const;

 private:
  const VoxelizeRequest request_;
  VoxelizeResult buckets_;
  std::vector<std::vector<uint32_t>> triangles_;
  std::vector<std::vector<uint64_t>> places_;  // of the fragments in the buckets
};

// Compares the engine's result of one request with the definition; test failures name `what`. Returns the share of
// voxels that were decided.
double ExpectByParts(const Assembly& assembly, const Solids& solids, const Fragments& fragments,
                     const VoxelizeRequest& request, const GridSpec& grid, const std::string& what);

// Element i of an array as stored: the low 1, 8, 16 or 32 bits.
uint32_t StoredAt(const HostBuffer& values, VoxelFormat format, uint64_t i);

}  // namespace voxelpipe::testing
