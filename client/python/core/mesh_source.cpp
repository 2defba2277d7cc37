#include "mesh_source.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string_view>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "base/wall_clock.h"
#include "load/decode/image.h"
#include "mesh/content_id.h"
#include "mesh/mesh_bytes.h"
#include "mesh/parts/part_list.h"
#include "mesh/placed_mesh.h"
#include "pipeline/warnings.h"
#include "shaders/catalog.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

bool Covers(const TextureUse& have, const TextureUse& want) {
  return (have.base_color || !want.base_color) && (have.emissive || !want.emissive) &&
         (have.metallic_roughness || !want.metallic_roughness);
}

}  // namespace

absl::StatusOr<std::shared_ptr<HeldMesh>> HeldMesh::Load(std::span<const uint8_t> file, MeshFileType type,
                                                         std::string name, const JobContext& job) {
  absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(job, file, {type, {}, {}});
  if (!loaded.ok()) return OfMesh(loaded.status());
  const absl::StatusOr<MeshReport> report = BoxReport(job, loaded->mesh);
  if (!report.ok()) return report.status();
  std::shared_ptr<HeldMesh> held(new HeldMesh);
  held->name_ = std::move(name);
  held->type_ = type;
  held->file_bytes_ = file.size();
  held->report_ = *report;
  held->mesh_ = std::move(loaded->mesh);
  ReleaseCharges(held->mesh_);
  CheckImages(held->mesh_);
  held->warnings_ = AllWarningsOf(held->mesh_);
  return held;
}

absl::Status HeldMesh::Prepare(const TextureUse& textures, const JobContext& job) {
  const auto prepared = [&] {
    const std::shared_lock lock(mutex_);
    return Covers(decoded_, textures);  // which textures only join
  };
  if (prepared()) return absl::OkStatus();
  const std::lock_guard decoding(decoding_);
  return prepared() ? absl::OkStatus() : Decode(textures, job);
}

absl::Status HeldMesh::Decode(const TextureUse& textures, const JobContext& job) {
  const std::unique_lock alone(mutex_);
  if (absl::Status s = PrepareTexturesFor(job, mesh_, {}, textures); !s.ok()) return OfMesh(s);
  ReleaseCharges(mesh_);
  decoded_.base_color |= textures.base_color;
  decoded_.emissive |= textures.emissive;
  decoded_.metallic_roughness |= textures.metallic_roughness;
  return absl::OkStatus();
}

absl::StatusOr<MeshReport> HeldMesh::Examined(const JobContext& job) {
  const std::lock_guard examining(examining_);
  if (!examined_) {
    const absl::StatusOr<MeshReport> report = ReportMesh(job, mesh_);
    if (!report.ok()) return report;
    examined_ = *report;
  }
  return *examined_;
}

v1::Mesh HeldMesh::Describe() const {
  v1::Mesh message;
  message.set_name(name_);
  message.set_format(ToMessage(type_.format));
  message.set_unit(ToMessage(type_.unit));
  message.set_file_bytes(int64_t(file_bytes_));
  {
    const std::shared_lock lock(mutex_);
    message.set_memory_bytes(int64_t(MeshBytes(mesh_)));
  }
  WriteTo(report_, false, *message.mutable_report());
  WriteWarnings(warnings_, message);
  return message;
}

absl::StatusOr<MeshHealth> HeldMesh::Health(const JobContext& job) const {
  const std::shared_lock lock(mutex_);
  return CheckHealth(job, mesh_);
}

absl::StatusOr<std::unique_ptr<UsedMesh>> UsedMesh::Open(const MeshSource& source, const ParsedConfig& config,
                                                         const JobContext& job) {
  const VoxelizeRequest& request = config.request;
  std::unique_ptr<UsedMesh> used(new UsedMesh);
  if (config.placed) {
    if (absl::Status s = used->Place(source, *config.placed, request, job); !s.ok()) return s;
  } else if (source.held) {
    if (absl::Status s = used->Hold(source, TexturesRead(request), job); !s.ok()) return s;
  } else {
    absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(job, source.file, {source.type, TexturesRead(request), {}});
    if (!loaded.ok()) return OfMesh(loaded.status());
    used->loaded_ = *std::move(loaded);
    used->mesh_ = &used->loaded_->mesh;
    used->stages_ = {{"load", used->loaded_->load_ms}, {"flatten", used->loaded_->flatten_ms}};
    used->peak_bytes_ = used->loaded_->peak_bytes;
  }
  if (absl::Status s = used->LeaveOut(request.parts, job); !s.ok()) return s;
  used->examined_ = request.fill != Fill::kNone;
  const absl::StatusOr<MeshReport> report = used->Report(job);
  if (!report.ok()) return report.status();
  used->report_ = *report;
  return used;
}

absl::StatusOr<MeshReport> UsedMesh::Report(const JobContext& job) const {
  if (!held_.empty() && !made_) return examined_ ? held_[0]->Examined(job) : held_[0]->report_;
  return examined_ ? ReportMesh(job, *mesh_) : BoxReport(job, *mesh_);
}

absl::Status UsedMesh::Hold(const MeshSource& source, const TextureUse& textures, const JobContext& job) {
  held_ = {source.held};
  HeldMesh& held = *source.held;
  if (absl::Status s = held.Prepare(textures, job); !s.ok()) return s;
  locks_.emplace_back(held.mutex_);
  mesh_ = &held.mesh_;
  peak_bytes_ = MeshBytes(*mesh_);
  return source.positions ? Move(*source.positions) : absl::OkStatus();
}

absl::Status UsedMesh::Move(std::span<const uint8_t> positions) {
  constexpr uint64_t kPositionBytes = 3 * sizeof(float);
  const uint64_t vertices = mesh_->positions.size();
  if (positions.size() != vertices * kPositionBytes) {
    return absl::InvalidArgumentError(absl::StrCat("new_positions: ", vertices * kPositionBytes,
                                                   " bytes are wanted, x, y, z of ", vertices, " vertices; ",
                                                   positions.size(), " came"));
  }
  TriangleMesh& moved = made_.emplace(*mesh_);
  moved.content_id = NewMovedId(moved.content_id);
  for (size_t i = 0; i < vertices; ++i) {
    float xyz[3];
    std::memcpy(xyz, positions.data() + i * kPositionBytes, sizeof xyz);
    if (!std::isfinite(xyz[0]) || !std::isfinite(xyz[1]) || !std::isfinite(xyz[2])) {
      return absl::InvalidArgumentError(absl::StrCat("new_positions: vertex ", i, " is not finite"));
    }
    moved.positions[i] = {xyz[0], xyz[1], xyz[2]};
  }
  mesh_ = &moved;
  peak_bytes_ += MeshBytes(moved) + positions.size();
  return absl::OkStatus();
}

absl::Status UsedMesh::LeaveOut(const PartSelection& parts, const JobContext& job) {
  if (parts.exclude.empty()) return absl::OkStatus();
  absl::StatusOr<TriangleMesh> kept = ExcludeParts(job, *mesh_, parts);
  if (!kept.ok()) return kept.status();
  mesh_ = &made_.emplace(*std::move(kept));
  loaded_.reset();
  peak_bytes_ += MeshBytes(*mesh_);
  return absl::OkStatus();
}

absl::Status UsedMesh::Place(const MeshSource& source, std::span<const PlacedStored> placed,
                             const VoxelizeRequest& request, const JobContext& job) {
  const TextureUse textures = TexturesRead(request);
  const Fill fill = request.fill;
  held_ = source.several;
  std::sort(held_.begin(), held_.end());  // every job locks in one order, so that no two wait for each other
  held_.erase(std::unique(held_.begin(), held_.end()), held_.end());
  std::unordered_map<std::string_view, std::shared_ptr<const TriangleMesh>> by_name;
  std::unordered_map<std::string_view, uint64_t> open_edges;  // counted once for each mesh, where something is filled
  for (const std::shared_ptr<HeldMesh>& held : held_) {
    if (absl::Status s = held->Prepare(textures, job); !s.ok()) return s;
    by_name.emplace(held->name_, std::shared_ptr<const TriangleMesh>(held, &held->mesh_));  // shared, not copied
    if (fill == Fill::kNone) continue;
    const absl::StatusOr<MeshReport> report = held->Examined(job);
    if (!report.ok()) return report.status();
    open_edges.emplace(held->name_, report->open_edges);
  }
  for (const std::shared_ptr<HeldMesh>& held : held_) {
    locks_.emplace_back(held->mutex_);  // until the job has ended: the placed mesh shares their images
    peak_bytes_ += MeshBytes(held->mesh_);
  }
  job.Report("place", 0);
  const double begin = WallMs();
  std::vector<PlacedMesh> meshes;
  meshes.reserve(placed.size());
  for (const PlacedStored& one : placed) {
    const auto mesh = by_name.find(one.mesh);
    if (mesh == by_name.end()) return MissingMeshError(one.mesh);
    meshes.push_back({mesh->second, one.matrix, one.name, one.label, one.priority, one.motion});
    if (const auto known = open_edges.find(one.mesh); known != open_edges.end())
      meshes.back().open_edges = known->second;
  }
  absl::StatusOr<TriangleMesh> mesh = PlaceMeshes(job, meshes);
  if (!mesh.ok()) return mesh.status();
  mesh_ = &made_.emplace(*std::move(mesh));
  peak_bytes_ += MeshBytes(*mesh_);
  stages_ = {{"place", WallMs() - begin}};
  job.Report("place", 1);
  return absl::OkStatus();
}

}  // namespace voxelpipe
