// Answers: core types <-> messages. Used by the server (To...) and by the client (From...). WriteTo is ToMessage into a fresh message that stands
// already, on an arena, say.
#pragma once

#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "grid/grid_spec.h"
#include "mesh/report.h"
#include "pipeline/plan.h"
#include "pipeline/request.h"
#include "pipeline/result.h"
#include "pipeline/stats.h"
#include "shaders/catalog.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// index_to_world is derived: it is written for readers in other languages and ignored by FromMessage.
v1::Grid ToMessage(const GridSpec& grid);
void WriteTo(const GridSpec& grid, v1::Grid& message);
// DATA_LOSS unless dims are 1 to kMaxGridDim an axis and 2^53 voxels in all, and the voxel size is positive.
absl::StatusOr<GridSpec> FromMessage(const v1::Grid& message);

v1::VoxelizationPlan ToMessage(const Plan& plan);
void WriteTo(const Plan& plan, v1::VoxelizationPlan& message);
absl::StatusOr<Plan> FromMessage(const v1::VoxelizationPlan& message);

v1::VoxelizeStats ToMessage(const VoxelizeStats& stats);
void WriteTo(const VoxelizeStats& stats, v1::VoxelizeStats& message);
VoxelizeStats FromMessage(const v1::VoxelizeStats& message);

// `examined`: whether degenerate_triangles and open_edges were counted.
v1::MeshReport ToMessage(const MeshReport& report, bool examined);
// The same with the loader's warnings, at most 32 of them, each cut to a line's length.
v1::MeshReport ToMessage(const MeshReport& report, bool examined, std::span<const std::string> warnings);
void WriteTo(const MeshReport& report, bool examined, std::span<const std::string> warnings, v1::MeshReport& message);
MeshReport FromMessage(const v1::MeshReport& message);

v1::ShaderInfo ToMessage(const ShaderInfo& info);
ShaderInfo FromMessage(const v1::ShaderInfo& message);

v1::ResultHeader ToMessage(const ResultHeader& header);
void WriteTo(const ResultHeader& header, v1::ResultHeader& message);
// In: what the server announces, and what it was asked for. Out: the same as the core knows it, arrays named, typed and shaped as
// result.h says for the request's kind, targets and layout. The sizes of sparse and bucketed lists are the server's to say, within
// what the grid can hold.
// DATA_LOSS naming what differs: the grid, the kind, the layout, the number of arrays, or an array's name, type or shape.
absl::StatusOr<ResultHeader> FromMessage(const v1::ResultHeader& message, const VoxelizeRequest& request);

}  // namespace voxelpipe
