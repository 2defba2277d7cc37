#include "gpu/parity/parity_run.h"

#include <utility>

#include "pipeline/voxelize.h"

namespace voxelpipe::gpu {
namespace {

class KeepArrays final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader& header) override {
    delivered.header = header;
    delivered.arrays.resize(header.arrays.size());
    return absl::OkStatus();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    delivered.arrays.at(array).insert(delivered.arrays[array].end(), bytes.begin(), bytes.end());
    return absl::OkStatus();
  }
  Delivered delivered;
};

}  // namespace

absl::StatusOr<Delivered> Run(const TriangleMesh& mesh, const ParityCase& c, const JobContext& job) {
  PlanLimits limits;
  limits.slab_depth = c.slab_depth;
  KeepArrays sink;
  if (c.streamed) {
    absl::StatusOr<VoxelizeStats> stats = VoxelizeTo(mesh, c.request, {job, limits}, sink);
    if (!stats.ok()) return stats.status();
    sink.delivered.stats = *std::move(stats);
    return std::move(sink.delivered);
  }
  absl::StatusOr<VoxelizeResult> result = Voxelize(mesh, c.request, {job, limits});
  if (!result.ok()) return result.status();
  if (absl::Status s = WriteTo(*result, sink); !s.ok()) return s;
  sink.delivered.stats = std::move(result->stats);
  return std::move(sink.delivered);
}

}  // namespace voxelpipe::gpu
