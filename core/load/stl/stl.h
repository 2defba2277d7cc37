// STL, binary and ASCII -> Scene.
// Sources: 3D Systems, "Stereolithography Interface Specification" (1989); binary layout as M. Burns, "Automated
// Fabrication" (1993), section 6.5, describes it.
#pragma once

#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// True if the size of the file is that of a binary STL of as many triangles as its header says: 84 + 50 * count. A
// header that begins with "solid" does not make it ASCII.
bool IsBinaryStl(std::span<const uint8_t> beginning, uint64_t file_bytes);

// In: a whole file. Out: one primitive with three vertices of its own for each facet, in file order. Facet normals are
// not read: they follow from the vertices. Attribute bytes (colours of some programs, each in its own way) are ignored
// with a warning. Errors: INVALID_ARGUMENT naming the byte, triangle or line; RESOURCE_EXHAUSTED naming the limit; the
// job's, which is polled between triangles.
absl::StatusOr<Scene> LoadStl(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits);

}  // namespace voxelpipe
