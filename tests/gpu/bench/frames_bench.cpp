// Frames a second of two kept bodies that turn against each other in a box of fluid: both in one request, where each
// frame places them anew, beside two requests a frame, each of a kept mesh that its vertex shader moves.
//
// usage: frames_bench [cuda|cpu] [FRAMES (1000)] [RESOLUTION (128)]
//
// A frame has a label and a velocity for each voxel, inside of the bodies too, as a solver of flow takes them. Wall
// clock from the call to the result in memory. Exit: 0, 77 where there is no such backend.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "mesh/placed_mesh.h"
#include "mesh/report.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

constexpr int kRings = 50;  // 10,000 triangles

struct Body {
  std::shared_ptr<const TriangleMesh> mesh;
  Vec3d center;
  double turns_per_frame;  // about z
};

Mat4d At(const Body& body, int frame) {
  Mat4d matrix = testing::Rotation({0, 0, 1}, body.turns_per_frame * double(frame));
  for (int a = 0; a < 3; ++a) matrix.m[a][3] = body.center[a];
  return matrix;
}

VoxelizeRequest Frame(int64_t resolution) {
  VoxelizeRequest request;
  const double size = 6.0 / double(resolution);
  request.grid.dims = {resolution, resolution, resolution};
  request.grid.origin = Vec3d{-3, -3, -3};
  request.grid.voxel_size = Vec3d{size, size, size};
  request.coverage = Coverage::kThin;
  request.fill = Fill::kNonzero;
  request.targets.resize(2);
  request.targets[0].format = VoxelFormat::kU8;
  request.targets[0].blend = request.targets[1].blend = Blend::kReplace;
  request.targets[0].shader.name = "label";
  request.targets[1].format = VoxelFormat::kF32;
  request.targets[1].components = 3;
  request.targets[1].shader.name = "velocity";
  return request;
}

class Frames {
 public:
  Frames(const Backend& backend, int64_t resolution) : backend_(backend), resolution_(resolution) {
    for (uint32_t i = 0; i < 2; ++i) {
      TriangleMesh mesh = testing::BumpySphere(kRings, i + 1);
      mesh.content_id = "body " + std::to_string(i);
      bodies_.push_back(
          {std::make_shared<const TriangleMesh>(std::move(mesh)), {i == 0 ? -1.2 : 1.2, 0, 0}, i == 0 ? 0.02 : -0.03});
      open_edges_.push_back(*CountOpenEdges(JobContext(), *bodies_.back().mesh));  // once, as a server does
    }
  }

  bool Together(int frame) const {
    std::vector<PlacedMesh> placed;
    for (size_t i = 0; i < bodies_.size(); ++i) {
      const Body& body = bodies_[i];
      PlacedMesh& one = placed.emplace_back();
      one.mesh = body.mesh;
      one.matrix = At(body, frame);
      one.motion = RigidMotionNumbers{{0, 0, 0}, {0, 0, body.turns_per_frame}, body.center};
      one.open_edges = open_edges_[i];
    }
    const JobContext job;
    const absl::StatusOr<TriangleMesh> mesh = PlaceMeshes(job, placed);
    if (!mesh.ok()) return Fail(mesh.status());
    VoxelizeRequest request = Frame(resolution_);
    request.parts.scope = PartScope::kFile;
    return Run(*mesh, request);
  }

  bool OneByOne(int frame) const {
    for (const Body& body : bodies_) {
      VoxelizeRequest request = Frame(resolution_);
      const Mat4d matrix = At(body, frame);
      request.vertex_shader.name = "transform";
      std::vector<double>& numbers = request.vertex_shader.parameters["matrix"];
      for (const auto& row : matrix.m) numbers.insert(numbers.end(), row, row + 4);
      request.vertex_shader.parameters["angular_velocity"] = {0, 0, body.turns_per_frame};
      request.vertex_shader.parameters["center"] = {body.center.x, body.center.y, body.center.z};
      if (!Run(*body.mesh, request)) return false;
    }
    return true;
  }

 private:
  static bool Fail(const absl::Status& status) {
    std::fprintf(stderr, "frames_bench: %s\n", std::string(status.message()).c_str());
    return false;
  }
  bool Run(const TriangleMesh& mesh, const VoxelizeRequest& request) const {
    const JobContext job;
    const absl::StatusOr<VoxelizeResult> result = Voxelize(mesh, request, {.job = job, .backend = &backend_});
    return result.ok() ? result->stats.occupied > 0 : Fail(result.status());
  }

  const Backend& backend_;
  const int64_t resolution_;
  std::vector<Body> bodies_;
  std::vector<uint64_t> open_edges_;
};

template <typename OfFrame>
double PerSecond(int frames, const OfFrame& of_frame) {
  for (int i = 0; i < 5; ++i) {
    if (!of_frame(i)) return 0;
  }
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < frames; ++i) {
    if (!of_frame(i)) return 0;
  }
  return double(frames) / std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

int Main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "cuda";
  const int frames = argc > 2 ? std::atoi(argv[2]) : 1000;
  const int64_t resolution = argc > 3 ? std::atoll(argv[3]) : 128;
  const absl::StatusOr<const Backend*> backend =
      SelectBackend(name == "cpu" ? BackendChoice::kCpu : BackendChoice::kCuda);
  if (!backend.ok()) {
    std::printf("SKIPPED: %s\n", std::string(backend.status().message()).c_str());
    return 77;
  }
  const Frames two(**backend, resolution);
  const double together = PerSecond(frames, [&](int i) { return two.Together(i); });
  const double one_by_one = PerSecond(frames, [&](int i) { return two.OneByOne(i); });
  if (together == 0 || one_by_one == 0) return 1;
  std::printf("%s, %d frames at %lld^3: one request %.0f frames a second, two requests %.0f: %.2f times\n",
              std::string((*backend)->device()).c_str(), frames, static_cast<long long>(resolution), together,
              one_by_one, together / one_by_one);
  return 0;
}

}  // namespace
}  // namespace voxelpipe::gpu

int main(int argc, char** argv) {
  return voxelpipe::gpu::Main(argc, argv);
}
