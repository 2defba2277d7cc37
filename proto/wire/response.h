// Responses: core types <-> messages. Used by the server (To...) and by the client (From...). WriteTo is ToMessage into
// an existing empty message, for example on an arena.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "base/warning.h"
#include "grid/grid_spec.h"
#include "job/request.h"
#include "job/result.h"
#include "job/stats.h"
#include "mesh/report.h"
#include "pipeline/plan/plan.h"
#include "shaders/catalog.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/count.h"

namespace voxelpipe {

// index_to_world is derived: it is written for readers in other languages and ignored by FromMessage.
v1::Grid ToMessage(const GridSpec& grid);
void WriteTo(const GridSpec& grid, v1::Grid& message);
// DATA_LOSS unless dims are 1 to kMaxGridDim an axis and at most 2^53 voxels in all, and the voxel size is positive.
absl::StatusOr<GridSpec> FromMessage(const v1::Grid& message);

v1::VoxelizationPlan ToMessage(const Plan& plan);
void WriteTo(const Plan& plan, v1::VoxelizationPlan& message);
absl::StatusOr<Plan> FromMessage(const v1::VoxelizationPlan& message);

v1::VoxelizeStats ToMessage(const VoxelizeStats& stats);
void WriteTo(const VoxelizeStats& stats, v1::VoxelizeStats& message);
VoxelizeStats FromMessage(const v1::VoxelizeStats& message);

// `examined`: true if degenerate_triangles and open_edges were counted.
v1::MeshReport ToMessage(const MeshReport& report, bool examined);
void WriteTo(const MeshReport& report, bool examined, v1::MeshReport& message);
MeshReport FromMessage(const v1::MeshReport& message);

// The fields `warnings` and `warnings_left_out` of a Summary, a Mesh or an EstimateVoxelizationResponse.
void WriteTo(const Warning& warning, v1::Warning& message);
Warning FromMessage(const v1::Warning& message);
template <typename Message>
void WriteWarnings(const WarningList& warnings, Message& message) {
  for (const Warning& warning : warnings.kept()) WriteTo(warning, *message.add_warnings());
  if (warnings.left_out() > 0) message.set_warnings_left_out(int64_t(warnings.left_out()));
}
// An unknown code counts as nonconforming_file; warnings beyond the limit of WarningList count as left out.
template <typename Message>
WarningList ReadWarnings(const Message& message) {
  WarningList warnings;
  for (const v1::Warning& warning : message.warnings()) {
    const Warning read = FromMessage(warning);
    warnings.Add(read.code, read.place, read.text);
  }
  warnings.set_left_out(warnings.left_out() + CountOf(message.warnings_left_out()));
  return warnings;
}

v1::ShaderInfo ToMessage(const ShaderInfo& info);
ShaderInfo FromMessage(const v1::ShaderInfo& message);

// `request`: what the result was made for, with every default filled in.
v1::ResultHeader ToMessage(const ResultHeader& header, const VoxelizeRequest& request);
void WriteTo(const ResultHeader& header, const VoxelizeRequest& request, v1::ResultHeader& message);
// In: the header from the server, and the request. Out: the header of the core, with arrays named, typed and shaped as
// in result.h for the request's kind, targets and layout. The server chooses the sizes of sparse and bucketed lists,
// within the bounds of the grid. DATA_LOSS naming what differs: the grid, the kind, the layout, the number of arrays,
// or an array's name, type or shape.
absl::StatusOr<ResultHeader> FromMessage(const v1::ResultHeader& message, const VoxelizeRequest& request);

}  // namespace voxelpipe
