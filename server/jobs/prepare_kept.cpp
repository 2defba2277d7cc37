#include "jobs/prepare_kept.h"

#include <chrono>
#include <cmath>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "mesh/mesh_bytes.h"
#include "mesh/placed_mesh.h"
#include "shaders/catalog.h"
#include "wire/placed.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kPositionBytes = 3 * sizeof(float);

// The mesh without its positions.
absl::StatusOr<std::shared_ptr<const TriangleMesh>> WithPositions(MeshStore& store, KeptMesh& kept,
                                                                  const std::shared_ptr<const TriangleMesh>& mesh,
                                                                  std::span<const uint8_t> positions) {
  std::shared_ptr<TriangleMesh> moved = store.Moved(kept, mesh);
  for (size_t i = 0; i < moved->positions.size(); ++i) {
    float xyz[3];
    std::memcpy(xyz, positions.data() + i * kPositionBytes, sizeof xyz);
    if (!std::isfinite(xyz[0]) || !std::isfinite(xyz[1]) || !std::isfinite(xyz[2])) {
      return absl::InvalidArgumentError(absl::StrCat("mesh.stored.positions: vertex ", i, " is not finite"));
    }
    moved->positions[i] = {xyz[0], xyz[1], xyz[2]};
  }
  return moved;
}

TextureUse TexturesOf(const ParsedConfig& config) {
  return RequestReadsTextures(config.request) ? TexturesRead(config.request) : TextureUse{};
}

// The meshes of the list with their textures. Charged to `charge`.
absl::StatusOr<std::vector<PlacedMesh>> ListPlaced(MeshStore& store, KeptMeshes kept, const ParsedConfig& config,
                                                   const JobLimits& limits, const JobContext& job,
                                                   MemoryCharge& charge) {
  const std::vector<PlacedStored>& list = *config.placed;
  const TextureUse textures = TexturesOf(config);
  if (absl::Status s = charge.Grow(BytesOf(list), "the list of placed meshes"); !s.ok()) return s;
  std::vector<PlacedMesh> meshes;
  meshes.reserve(list.size());
  for (size_t i = 0; i < list.size(); ++i) {
    if (absl::Status s = job.Check(); !s.ok()) return s;
    absl::StatusOr<std::shared_ptr<const TriangleMesh>> mesh =
        store.Mesh(job, *kept[i], textures, limits.load, limits.load_workers);
    if (!mesh.ok()) {
      if (!absl::IsInvalidArgument(mesh.status())) return mesh.status();
      const std::string why(mesh.status().message());
      return WithText(mesh.status(), absl::StrCat("mesh.placed.meshes[", i, "]: ", why));
    }
    const PlacedStored& from = list[i];
    meshes.push_back({*std::move(mesh), from.matrix, from.name, from.label, from.priority, from.motion});
    if (config.request.fill == Fill::kNone) continue;
    const absl::StatusOr<KeptMesh::Facts> facts = kept[i]->Examine(job);
    if (!facts.ok()) return facts.status();
    meshes.back().open_edges = facts->report.open_edges;
  }
  return meshes;
}

absl::StatusOr<std::shared_ptr<const PreparedMesh>> PreparePlaced(MeshStore& store, KeptMeshes kept,
                                                                  const ParsedConfig& config, const JobLimits& limits,
                                                                  const JobContext& job) {
  job.Report("load", 0);
  const auto begin = std::chrono::steady_clock::now();
  MemoryCharge charge(&MemoryOf(job));
  const absl::StatusOr<std::vector<PlacedMesh>> list = ListPlaced(store, kept, config, limits, job, charge);
  if (!list.ok()) return list.status();
  absl::StatusOr<TriangleMesh> placed = PlaceMeshes(job, *list, limits.load);
  if (!placed.ok()) return placed.status();
  auto prepared = std::make_shared<PreparedMesh>();
  prepared->peak_bytes = placed->memory->bytes() + charge.bytes();
  prepared->mesh = std::make_shared<const TriangleMesh>(*std::move(placed));
  prepared->examined = config.request.fill != Fill::kNone;
  if (absl::Status s = LeaveOutParts(config, job, *prepared); !s.ok()) return s;
  const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - begin;
  prepared->stages.emplace_back("load", time.count());
  job.Report("load", 1);
  if (absl::Status s = SetReport(job, *prepared); !s.ok()) return s;
  return prepared;
}

absl::StatusOr<std::shared_ptr<const PreparedMesh>> Prepare(MeshStore& store, KeptMeshes all,
                                                            std::span<const uint8_t> positions,
                                                            const ParsedConfig& config, const JobLimits& limits,
                                                            const JobContext& job) {
  if (absl::Status s = job.Check(); !s.ok()) return s;
  if (absl::Status s = CheckMeshBytes(all, config, positions.size(), true); !s.ok()) return s;
  if (config.placed) return PreparePlaced(store, all, config, limits, job);
  KeptMesh& kept = *all.front();
  const TextureUse textures = TexturesOf(config);
  absl::StatusOr<std::shared_ptr<const TriangleMesh>> mesh =
      store.Mesh(job, kept, textures, limits.load, limits.load_workers);
  if (!mesh.ok()) return mesh.status();
  auto prepared = std::make_shared<PreparedMesh>();
  prepared->mesh = *std::move(mesh);
  prepared->examined = config.request.fill != Fill::kNone;
  if (!config.new_positions && !config.request.parts.exclude.empty()) {
    if (absl::Status s = LeaveOutParts(config, job, *prepared); !s.ok()) return s;
    if (absl::Status s = SetReport(job, *prepared); !s.ok()) return s;
    return prepared;
  }
  if (!config.new_positions) {
    prepared->report = kept.Report().report;
    if (!prepared->examined) return prepared;
    const absl::StatusOr<KeptMesh::Facts> facts = kept.Examine(job);
    if (!facts.ok()) return facts.status();
    prepared->report = facts->report;
    return prepared;
  }
  job.Report("load", 0);
  const auto begin = std::chrono::steady_clock::now();
  prepared->memory = MemoryCharge(&MemoryOf(job));
  if (absl::Status s = prepared->memory.Grow(MeshBytes(*prepared->mesh), "the mesh with its new positions"); !s.ok()) {
    return s;
  }
  mesh = WithPositions(store, kept, prepared->mesh, positions);
  if (!mesh.ok()) return mesh.status();
  prepared->mesh = *std::move(mesh);
  prepared->peak_bytes = MeshBytes(*prepared->mesh) + positions.size();
  if (absl::Status s = LeaveOutParts(config, job, *prepared); !s.ok()) return s;
  const std::chrono::duration<double, std::milli> load_time = std::chrono::steady_clock::now() - begin;
  prepared->stages.emplace_back("load", load_time.count());
  job.Report("load", 1);
  if (absl::Status s = SetReport(job, *prepared); !s.ok()) return s;
  return prepared;
}

}  // namespace

absl::StatusOr<std::shared_ptr<const PreparedMesh>> PrepareKept(MeshStore& store, KeptMeshes kept,
                                                                std::span<const uint8_t> positions,
                                                                const ParsedConfig& config, const JobLimits& limits,
                                                                const JobContext& job) {
  try {
    return Prepare(store, kept, positions, config, limits, job);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the mesh");
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("unexpected: ", error.what()));
  }
}

uint64_t TrianglesOf(KeptMeshes kept) {
  uint64_t triangles = 0;
  for (const std::shared_ptr<KeptMesh>& mesh : kept) triangles += mesh->triangles();
  return triangles;
}

absl::Status CheckMeshBytes(KeptMeshes kept, const ParsedConfig& config, uint64_t bytes, bool all) {
  if (!config.new_positions) {
    if (bytes == 0) return absl::OkStatus();
    return absl::InvalidArgumentError(config.placed ? "mesh.placed: no mesh bytes may follow"
                                                    : "mesh.stored: no mesh bytes may follow, unless it has positions");
  }
  const uint64_t vertices = kept.front()->vertices();
  const uint64_t wanted = vertices * kPositionBytes;
  if (bytes == wanted || (bytes < wanted && !all)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("mesh.stored.positions: ", wanted, " bytes are wanted, x, y, z of ",
                                                 vertices, " vertices; ", all ? "" : "at least ", bytes, " came"));
}

}  // namespace voxelpipe
