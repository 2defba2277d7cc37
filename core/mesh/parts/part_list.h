// The parts of a mesh: sets of triangles that bound a solid of their own.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/memory_budget.h"
#include "base/warning.h"
#include "job/request.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

inline constexpr size_t kMaxParts = 65'535;

struct Part {
  std::string_view name;  // refers to the mesh; empty: it has none
  uint32_t label = 1;
  int32_t priority = 0;
  uint32_t rank = 0;  // its place when parts are ordered by (priority, number), from 0
  uint64_t first_triangle = 0, triangle_count = 0;
  uint32_t placed = 0;  // entry of TriangleMesh::placed that its first triangle is of
};

struct PartList {
  std::vector<Part> parts;               // by their first triangle; only parts with triangles
  std::vector<uint32_t> of_run;          // of each MeshPart the number of its part; 0 for those without triangles
  WarningList warnings;                  // patterns that match no part
  std::shared_ptr<MemoryCharge> memory;  // to the job's budget; copies share it
};

// In: a mesh and how it is cut into parts. Out: the parts. kWhole: one, without a name. A node instance, a mesh and a
// material have the file's names. Label: of the last rule that matches, otherwise with kFile that of the placed mesh,
// otherwise the part's number from 1. Priority: of the last rule, otherwise that of the placed mesh of its first
// triangle. Errors: INVALID_ARGUMENT for rules with kWhole, a label of 0, numbers out of range, more than kMaxPartRules
// rules or kMaxParts parts; RESOURCE_EXHAUSTED; the job's. The list refers to the names in the mesh.
absl::StatusOr<PartList> ListParts(const JobContext& job, const TriangleMesh& mesh, const PartSelection& selection);

// In: a mesh and a selection with patterns to exclude. Out: a mesh without the triangles of the parts whose names match
// one of them, and without their vertices; triangle ids count from 0 over those that are left. Mesh, node and material
// ids stay. Charged to the job's memory. A pattern that matches no part is a warning. Errors: ListParts';
// RESOURCE_EXHAUSTED.
absl::StatusOr<TriangleMesh> ExcludeParts(const JobContext& job, const TriangleMesh& mesh,
                                          const PartSelection& selection);

// True for each MeshPart that ExcludeParts leaves out; warns of patterns that match no part.
absl::StatusOr<std::vector<bool>> ExcludedRuns(const JobContext& job, const TriangleMesh& mesh,
                                               const PartSelection& selection, WarningList& warnings);

// True if `name` matches: `*` is any bytes, `?` one character, all else itself.
bool MatchesPattern(std::string_view pattern, std::string_view name);

}  // namespace voxelpipe
