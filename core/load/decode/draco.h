// Decodes Draco meshes; checks every reference.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// One attribute of a decoded Draco mesh, converted to float; integers are not scaled.
struct DracoAttribute {
  enum class Kind { kPosition, kNormal, kColor, kTexCoord, kOther };
  uint32_t unique_id = 0;
  Kind kind = Kind::kOther;
  std::string name;         // from its metadata, usually empty
  double integer_most = 0;  // the largest value of its integer type, 0 for floats
  // Integers are fractions of integer_most: flagged by the stream, or colours of unsigned bytes or shorts.
  bool normalized = false;
  int components = 0;         // 1-4
  std::vector<float> values;  // points * components
};

// Divides integers by the maximum of their type as glTF does (2.0, section 3.6.2.2): signed ones not below -1. Floats
// are not changed.
void Normalize(DracoAttribute& attribute);

struct DracoMesh {
  uint32_t points = 0;
  std::vector<std::array<uint32_t, 3>> triangles;  // every index below points
  std::vector<DracoAttribute> attributes;
  MemoryCharge memory;  // the charge of these arrays to the job's memory
};

// In: a whole Draco bitstream. Out: its mesh; a point cloud gives no triangles. Before anything is allocated, declared
// counts are checked against the byte size and the limits and charged to the job's memory: first faces, points and sets
// of attributes; once attributes are declared, their values. The job is polled between connectivity and the groups of
// attributes, but not within these steps, which take time in proportion to the file. Errors: INVALID_ARGUMENT saying
// what is broken; RESOURCE_EXHAUSTED naming the limit; the job's.
absl::StatusOr<DracoMesh> DecodeDraco(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits);

// A plain .drc file as a scene of one node, one mesh and one primitive (none for a point cloud). Generic attributes
// with a name in their metadata keep it. The job is polled before and after the stream is decoded.
absl::StatusOr<Scene> LoadDraco(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits);

}  // namespace voxelpipe
