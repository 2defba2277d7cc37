#include "meshes/kept_mesh.h"

#include <chrono>
#include <map>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "isolate/loading.h"
#include "load/decode/image.h"
#include "mesh/mesh_bytes.h"
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

// Overhead of an entry, including parts too small to count, so that many tiny meshes are not free.
constexpr uint64_t kOverheadBytes = 4096;

uint64_t BytesOf(const Warning& warning) {
  return sizeof warning + warning.place.size() + warning.text.size();
}

// MeshBytes and the small parts, which untrusted files can make large: names come from the file.
uint64_t KeptBytes(const TriangleMesh& mesh) {
  uint64_t bytes = kOverheadBytes + MeshBytes(mesh);
  bytes += mesh.parts.size() * sizeof(MeshPart) + mesh.textures.size() * sizeof(Texture);
  if (mesh.unused_vertices) bytes += mesh.unused_vertices->size() * sizeof(uint32_t);
  for (const Material& material : mesh.materials) {
    bytes += sizeof material + material.name.size();
    for (const TextureRef* ref : {&material.base_color, &material.emissive, &material.metallic_roughness}) {
      bytes += ref->fault.size();
    }
  }
  for (const VertexAttribute& attribute : mesh.attributes) bytes += sizeof attribute + attribute.name.size();
  for (const auto& image : mesh.images) {
    bytes += sizeof *image + image->name.size() + image->mime_type.size() + (image->fault ? BytesOf(*image->fault) : 0);
  }
  for (const Warning& warning : mesh.warnings.kept()) bytes += BytesOf(warning);
  return bytes;
}

bool Covers(const TextureUse& have, const TextureUse& want) {
  return (have.base_color || !want.base_color) && (have.emissive || !want.emissive) &&
         (have.metallic_roughness || !want.metallic_roughness);
}

TextureUse Both(const TextureUse& a, const TextureUse& b) {
  return {a.base_color || b.base_color, a.emissive || b.emissive, a.metallic_roughness || b.metallic_roughness};
}

// Decoded textures belong to the contents.
std::string ContentId(const std::string& id, const TextureUse& prepared) {
  if (!prepared.any()) return id;
  return absl::StrCat(id, "/", prepared.base_color ? "b" : "", prepared.emissive ? "e" : "",
                      prepared.metallic_roughness ? "m" : "");
}

// A mesh with images of its own, so that decoding them affects no other mesh.
std::shared_ptr<TriangleMesh> CopyWithImages(const TriangleMesh& mesh) {
  auto copy = std::make_shared<TriangleMesh>(mesh);
  std::map<const Image*, std::shared_ptr<Image>> copies;  // several may be one
  for (std::shared_ptr<Image>& image : copy->images) {
    if (!image) continue;
    std::shared_ptr<Image>& of = copies[image.get()];
    if (!of) of = std::make_shared<Image>(*image);
    image = of;
  }
  return copy;
}

}  // namespace

absl::StatusOr<std::shared_ptr<KeptMesh>> KeptMesh::Make(const JobContext& job, std::string name, MeshFileType type,
                                                         uint64_t file_bytes, LoadedMesh loaded) {
  const absl::StatusOr<MeshReport> report = BoxReport(job, loaded.mesh);
  if (!report.ok()) return report.status();
  return std::make_shared<KeptMesh>(std::move(name), type, file_bytes, std::move(loaded), *report);
}

KeptMesh::KeptMesh(std::string name, MeshFileType type, uint64_t file_bytes, LoadedMesh loaded,
                   const MeshReport& report)
    : name_(std::move(name)),
      type_(type),
      file_bytes_(file_bytes),
      triangles_(loaded.mesh.triangles.size()),
      vertices_(loaded.mesh.positions.size()) {
  loaded.mesh.content_id = name_;
  ReleaseCharges(loaded.mesh);  // counted here from now on
  facts_.report = report;
  CheckImages(loaded.mesh);
  facts_.warnings = AllWarningsOf(loaded.mesh);
  mesh_ = std::make_shared<const TriangleMesh>(std::move(loaded.mesh));
  memory_bytes_ = KeptBytes(*mesh_);
}

absl::StatusOr<std::shared_ptr<const TriangleMesh>> KeptMesh::Mesh(const JobContext& job, const TextureUse& use,
                                                                   const LoadLimits& limits, LoadWorkers* workers) {
  const auto ready = [&]() -> std::shared_ptr<const TriangleMesh> {
    const std::lock_guard lock(mutex_);
    return Covers(prepared_, use) ? mesh_ : nullptr;
  };
  if (auto mesh = ready()) return mesh;
  std::unique_lock preparing(preparing_, std::defer_lock);
  if (absl::Status s = Lock(preparing, job); !s.ok()) return s;
  if (auto mesh = ready()) return mesh;
  // Only this thread replaces mesh_ and prepared_ now.
  try {
    MemoryCharge charge(&MemoryOf(job));
    if (absl::Status s = charge.Grow(MeshBytes(*mesh_), "a copy of the mesh with its textures"); !s.ok()) return s;
    const std::shared_ptr<TriangleMesh> copy = CopyWithImages(*mesh_);
    if (absl::Status s = DecodeTextures(*copy, limits, use, workers, job); !s.ok()) return s;
    ReleaseCharges(*copy);
    const TextureUse prepared = Both(prepared_, use);
    copy->content_id = ContentId(name_, prepared);
    const uint64_t bytes = KeptBytes(*copy);
    std::shared_ptr<const TriangleMesh> old = copy;
    {
      const std::lock_guard lock(mutex_);
      mesh_.swap(old);
      prepared_ = prepared;
    }
    memory_bytes_ = bytes;
    return copy;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the mesh's textures");
  }
}

std::shared_ptr<TriangleMesh> KeptMesh::Moved(const std::shared_ptr<const TriangleMesh>& mesh, bool keep_one) {
  if (keep_one) keeps_moved_ = true;
  return moved_->Copy(mesh, keep_one);
}

bool KeptMesh::ready(const TextureUse& use) const {
  const std::lock_guard lock(mutex_);
  return Covers(prepared_, use);
}

absl::Status KeptMesh::Lock(std::unique_lock<std::timed_mutex>& preparing, const JobContext& job) {
  constexpr std::chrono::milliseconds kLookInterval{20};
  while (!preparing.try_lock_for(kLookInterval)) {
    if (absl::Status s = job.Check(); !s.ok()) return s;
  }
  return absl::OkStatus();
}

KeptMesh::Facts KeptMesh::Report() const {
  const std::lock_guard lock(mutex_);
  return facts_;
}

absl::StatusOr<KeptMesh::Facts> KeptMesh::Examine(const JobContext& job) {
  if (Facts facts = Report(); facts.examined) return facts;
  std::unique_lock preparing(preparing_, std::defer_lock);
  if (absl::Status s = Lock(preparing, job); !s.ok()) return s;
  if (Facts facts = Report(); facts.examined) return facts;
  const absl::StatusOr<MeshReport> report = ReportMesh(job, *mesh_);
  if (!report.ok()) return report.status();
  const std::lock_guard lock(mutex_);
  const Facts facts{*report, true, facts_.warnings};
  return facts_ = facts;
}

}  // namespace voxelpipe
