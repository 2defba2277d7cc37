#include "gpu/parity/memory_parity.h"

#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "gpu/parity/first_difference.h"
#include "gpu/parity/parity_run.h"
#include "load/decode/image.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"
#ifdef VOXELPIPE_HAVE_CUDA
#include "cuda/device/device.h"
#include "cuda/device/mesh_uploads.h"
#endif

namespace voxelpipe::gpu {

std::string Message(const absl::Status& status) {
  return absl::StrCat(absl::StatusCodeToString(status.code()), ": ", std::string(status.message()));
}

ParityCase CaseOfRanges() {
  ParityCase c;
  c.request.grid = Placed({70, 57, 8}, {-1, -0.1, -0.5}, {0.61, 0.11, 0.9});
  c.request.parts.scope = PartScope::kNode;
  c.request.fill = Fill::kNonzero;
  c.request.coverage = Coverage::kNone;
  c.request.targets[0].format = VoxelFormat::kU16;
  c.request.targets[0].blend = Blend::kReplace;
  c.request.targets[0].shader = {"label", {}};
  return c;
}

std::optional<std::string> RowsInRanges(const TriangleMesh& mesh, ParityCase c) {
#ifdef VOXELPIPE_HAVE_CUDA
  c.request.backend = BackendChoice::kCpu;
  const absl::StatusOr<Delivered> expected = Run(mesh, c);
  if (!expected.ok()) return Message(expected.status());
  c.request.backend = BackendChoice::kCuda;
  constexpr uint64_t kEnough = 3 << 19;
  for (uint64_t room = 12 << 20; room >= 1 << 10; room /= 2) {
    cuda::LimitMemory(cuda::MemoryTaken() + room);
    const absl::StatusOr<Delivered> got = Run(mesh, c);
    cuda::LimitMemory(UINT64_MAX);
    if (got.ok()) {
      if (const auto difference = FirstDifference(*expected, *got)) return absl::StrCat(room, " bytes: ", *difference);
      continue;
    }
    const std::string why = Message(got.status());
    const bool says_need = absl::StrContains(why, "bytes of device memory needed");
    if (absl::StartsWith(why, "RESOURCE_EXHAUSTED") && says_need && room < kEnough) return std::nullopt;
    return absl::StrCat(room, " bytes: ", why);
  }
  return "1 KiB was enough";
#else
  (void)mesh, (void)c;
  return std::nullopt;
#endif
}

std::optional<std::string> MoreThanDevicesHave(std::string& refusal) {
  ParityCase c;
  c.request.backend = BackendChoice::kCuda;
  c.request.grid = Placed({28000, 28000, 8}, {0, 0, 0}, {1, 1, 1});
  c.request.targets[0].format = VoxelFormat::kF32;
  c.request.targets[0].components = 4;
  c.request.targets[0].blend = Blend::kMax;
  c.request.targets.resize(kMaxTargets, c.request.targets[0]);
  PlanLimits limits;
  limits.max_result_bytes = limits.max_working_bytes = limits.slab_bytes = UINT64_MAX / 4;
  const TriangleMesh mesh = testing::Cube(16);
  const absl::Status status = Voxelize(mesh, c.request, {JobContext(), limits}).status();
  c.request.grid.dims = {30000, 30000, 8};
  c.request.targets = {TargetSpec()};
  const absl::Status face = Voxelize(mesh, c.request, {JobContext(), limits}).status();
  for (const absl::Status& s : {status, face}) {
    if (!absl::IsResourceExhausted(s) || DeviceFailureOf(s) != DeviceFailureKind::kOutOfMemory) return Message(s);
  }
  c.request.grid.dims = {64, 64, 64};
  const absl::Status after = Voxelize(mesh, c.request, {JobContext()}).status();
  if (!after.ok()) return "afterwards: " + Message(after);
  refusal = Message(status);
  return std::nullopt;
}

std::optional<std::string> TextureOfKeptMesh() {
#ifdef VOXELPIPE_HAVE_CUDA
  TriangleMesh mesh = testing::AttributedSoup(200, 24, 5);
  auto image = std::make_shared<Image>();
  image->width = image->height = 64;
  for (uint32_t i = 0; i < 4 * 64 * 64; ++i) image->rgba.push_back(uint8_t(i * 2654435761u >> 24));
  mesh.images = {image};
  mesh.textures = {Texture{.image = 0}, Texture{.image = 0, .nearest = true}};
  mesh.materials[0].emissive.texture = 1;
  if (absl::Status s = PrepareTextures(mesh); !s.ok()) return Message(s);
  mesh.content_id = "with a texture";
  ParityCase c;
  c.request.grid = Placed({24, 24, 24}, {0, 0, 0}, {1, 1, 1});
  c.request.targets.resize(2);
  for (size_t t = 0; t < 2; ++t) {
    TargetSpec& target = c.request.targets[t];
    target.format = VoxelFormat::kU8;
    target.components = t == 0 ? 4 : 3;
    target.blend = Blend::kReplace;
    target.shader = {t == 0 ? "base_color" : "emissive", {}};
  }
  c.request.backend = BackendChoice::kCpu;
  const absl::StatusOr<Delivered> expected = Run(mesh, c);
  if (!expected.ok()) return Message(expected.status());
  c.request.backend = BackendChoice::kCuda;
  const uint64_t texels = 4 * 64 * 64;
  for (int run = 0; run < 3; ++run) {
    const uint64_t before = cuda::MeshUploadedBytes(0);
    const absl::StatusOr<Delivered> got = Run(mesh, c);
    const uint64_t uploaded = cuda::MeshUploadedBytes(0) - before;
    if (!got.ok()) return Message(got.status());
    if (const auto difference = FirstDifference(*expected, *got)) return absl::StrCat("run ", run, ": ", *difference);
    if (run > 0 ? uploaded >= texels / 4 : uploaded < texels) {
      return absl::StrCat("run ", run, ": ", uploaded, " bytes of the mesh went up");
    }
  }
#endif
  return std::nullopt;
}

}  // namespace voxelpipe::gpu
