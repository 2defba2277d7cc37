// Predicted cost of a job from sizes, and its correction by recent measurements.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "grid/grid_spec.h"
#include "job/request.h"
#include "load/loader.h"
#include "schedule/task.h"

namespace voxelpipe {

// The known facts about the mesh of a job.
struct MeshFacts {
  MeshFormat format = MeshFormat::kAuto;
  bool compressed = false;            // the file's geometry, in any format
  uint64_t file_bytes = 0;            // 0 after loading
  uint64_t memory_bytes = 0;          // of the mesh, after loading
  std::optional<uint64_t> triangles;  // absent: estimated from the file's size
  std::optional<Box3d> box;           // absent: a cube is assumed
};

// The cost of `request` on this mesh. Milliseconds are those of one thread of a server's processor; MeasuredCost
// corrects them. Checks nothing: a request that cannot be run has a cost too.
JobCost PredictCost(const VoxelizeRequest& request, const MeshFacts& mesh);

// Milliseconds of placing so many meshes with so many triangles together on one grid.
double PredictPlaceMs(size_t meshes, uint64_t triangles);

// Milliseconds of writing the result of such a job as a file: formats compress, draw or list its voxels.
double PredictExportMs(const JobCost& cost);

// The cost of loading the file alone: for tasks that end on a loader without a run.
JobCost PredictLoadCost(const MeshFacts& mesh);

// The cost of planning `request` on this mesh instead of running it: loading the file, if there is one, and measuring
// the mesh, all of it on a loader.
JobCost PredictEstimateCost(const VoxelizeRequest& request, const MeshFacts& mesh);

// Size classes of jobs; jobs of a class are scheduled together.
enum class SizeClass : uint8_t { kSmall, kMedium, kGiant };
inline constexpr size_t kSizeClasses = 3;

// The kind of worker that was measured.
enum class WorkKind : uint8_t { kLoad, kCpu, kCuda };
inline constexpr size_t kWorkKinds = 3;

// Measured against predicted milliseconds, smoothed, for each kind of work and size of job. Not thread-safe.
class MeasuredCost {
 public:
  MeasuredCost();
  // `measured_ms` is that of a whole batch, `predicted_ms` the sum of PredictCost over its jobs; 0: nothing was
  // predicted, and nothing is learnt.
  void Observe(WorkKind kind, SizeClass size, double predicted_ms, double measured_ms);
  // The correction factor of predictions: between 1/64 and 64.
  double Ratio(WorkKind kind, SizeClass size) const { return ratios_[size_t(kind)][size_t(size)]; }

 private:
  std::array<std::array<double, kSizeClasses>, kWorkKinds> ratios_;
};

}  // namespace voxelpipe
