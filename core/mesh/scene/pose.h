// A pose of a rig: every part's matrices and morph weights at a time of an animation. Host only: uses libm, once a run.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/rig.h"
#include "mesh/scene/vertex_pose.h"

namespace voxelpipe {

struct PoseQuery {
  std::optional<uint32_t> animation;           // absent: the file's own pose
  double time = 0;                             // seconds
  bool nodes = true;                           // false: nodes and joints stay in the file's own pose (`morph`)
  std::optional<std::vector<double>> weights;  // of every morphed mesh, instead of the file's
};

// One pose; views point into it, and it must not be copied.
struct Pose {
  Pose() = default;
  Pose(const Pose&) = delete;
  Pose& operator=(const Pose&) = delete;
  std::vector<std::vector<Mat4d>> skins;            // skinning matrices
  std::vector<std::vector<double>> target_weights;  // one a morph target; instances of a node share them
  std::vector<PoseView> parts;                      // one a part of the rig
  MemoryCharge memory;                              // of all this
};

// Errors: INVALID_ARGUMENT for an animation that does not exist or cannot be played, a morph target that is not usable,
// more weights than any primitive has targets, weights without targets.
absl::StatusOr<std::unique_ptr<Pose>> EvaluatePose(const Rig& rig, const PoseQuery& query);
// The same for a job that may end; the pose is charged to MemoryOf(job). Errors: RESOURCE_EXHAUSTED and the job's, too.
absl::StatusOr<std::unique_ptr<Pose>> EvaluatePoseFor(const JobContext& job, const Rig& rig, const PoseQuery& query);

// The unposed primitive of a part; `targets` receives the views that the result points to, and must live as long.
RestPrimitiveView RestView(const Primitive& primitive, std::vector<MorphTargetView>& targets);

}  // namespace voxelpipe
