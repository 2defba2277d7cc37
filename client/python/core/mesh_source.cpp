#include "mesh_source.h"

#include <cmath>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "load/decode/image.h"
#include "mesh/content_id.h"
#include "mesh/mesh_bytes.h"
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
  if (source.held) {
    if (absl::Status s = used->Hold(source, TexturesRead(request), job); !s.ok()) return s;
  } else {
    absl::StatusOr<LoadedMesh> loaded = LoadMeshFor(job, source.file, {source.type, TexturesRead(request), {}});
    if (!loaded.ok()) return OfMesh(loaded.status());
    used->loaded_ = *std::move(loaded);
    used->mesh_ = &used->loaded_->mesh;
    used->stages_ = {{"load", used->loaded_->load_ms}, {"flatten", used->loaded_->flatten_ms}};
    used->peak_bytes_ = used->loaded_->peak_bytes;
  }
  used->examined_ = request.fill != Fill::kNone;
  const absl::StatusOr<MeshReport> report = used->Report(job);
  if (!report.ok()) return report.status();
  used->report_ = *report;
  return used;
}

absl::StatusOr<MeshReport> UsedMesh::Report(const JobContext& job) const {
  if (held_ != nullptr && !moved_) return examined_ ? held_->Examined(job) : held_->report_;
  return examined_ ? ReportMesh(job, *mesh_) : BoxReport(job, *mesh_);
}

absl::Status UsedMesh::Hold(const MeshSource& source, const TextureUse& textures, const JobContext& job) {
  held_ = source.held;
  HeldMesh& held = *held_;
  lock_ = std::shared_lock(held.mutex_);
  if (!Covers(held.decoded_, textures)) {
    lock_.unlock();
    const std::lock_guard decoding(held.decoding_);
    lock_.lock();
    if (!Covers(held.decoded_, textures)) {
      lock_.unlock();
      if (absl::Status s = held.Decode(textures, job); !s.ok()) return s;
      lock_.lock();
    }
  }
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
  TriangleMesh& moved = moved_.emplace(*mesh_);
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

}  // namespace voxelpipe
