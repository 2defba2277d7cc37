// What a job will take: a guess from sizes, and how wrong the guesses of late were.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "grid/grid_spec.h"
#include "job/request.h"
#include "load/loader.h"
#include "schedule/task.h"

namespace voxelpipe {

// What is known of the mesh of a job.
struct MeshFacts {
  MeshFormat format = MeshFormat::kAuto;
  bool compressed = false;            // the file's geometry, whatever its format
  uint64_t file_bytes = 0;            // 0 once it is loaded
  uint64_t memory_bytes = 0;          // of the mesh, once it is loaded
  std::optional<uint64_t> triangles;  // absent: guessed from the file's size
  std::optional<Box3d> box;           // absent: taken for a cube
};

// The cost of `request` on this mesh. Milliseconds are those of one thread of a server's processor; MeasuredCost
// corrects them. Nothing is checked: a request that cannot be run costs something, too.
JobCost PredictCost(const VoxelizeRequest& request, const MeshFacts& mesh);

// Jobs of a size are served together.
enum class SizeClass : uint8_t { kSmall, kMedium, kGiant };
inline constexpr size_t kSizeClasses = 3;

// What did the work that was measured.
enum class WorkKind : uint8_t { kLoad, kCpu, kCuda };
inline constexpr size_t kWorkKinds = 3;

// Measured against predicted milliseconds, smoothed, for each kind of work and size of job. Not thread-safe.
class MeasuredCost {
 public:
  MeasuredCost();
  // `measured_ms` is a whole batch's, `predicted_ms` what PredictCost said of its jobs together.
  void Observe(WorkKind kind, SizeClass size, double predicted_ms, double measured_ms);
  // What to multiply a prediction with: between 1/64 and 64.
  double Ratio(WorkKind kind, SizeClass size) const { return ratios_[size_t(kind)][size_t(size)]; }

 private:
  std::array<std::array<double, kSizeClasses>, kWorkKinds> ratios_;
};

}  // namespace voxelpipe
