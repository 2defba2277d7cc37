#include "wire/placed.h"

#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "mesh/placed_mesh.h"
#include "wire/mesh_name.h"

namespace voxelpipe {
namespace {

constexpr int kMatrixNumbers = 16;

absl::Status Invalid(const std::string& field, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat(field, ": ", why));
}

absl::Status ReadMatrix(const google::protobuf::RepeatedField<double>& numbers, const std::string& mesh, Mat4d& out) {
  if (numbers.empty()) return absl::OkStatus();
  if (numbers.size() != kMatrixNumbers) {
    return Invalid(mesh + ".matrix",
                   absl::StrCat(kMatrixNumbers, " numbers are needed, row by row, ", numbers.size(), " given"));
  }
  for (int i = 0; i < kMatrixNumbers; ++i) out.m[i / 4][i % 4] = numbers[i] + 0.0;  // -0 becomes 0
  const absl::Status wrong = CheckPlacement(out);
  if (wrong.ok()) return wrong;
  return absl::InvalidArgumentError(absl::StrCat(mesh, ".", std::string(wrong.message())));
}

absl::Status ReadVec(const v1::Vec3& from, const std::string& field, Vec3d& out) {
  out = {from.x(), from.y(), from.z()};
  for (int a = 0; a < 3; ++a) {
    if (!std::isfinite(out[a])) return Invalid(absl::StrCat(field, ".", std::string(1, "xyz"[a])), "must be finite");
  }
  return absl::OkStatus();
}

absl::Status Read(const v1::PlacedMesh& from, uint32_t number, const std::string& field, PlacedStored& out) {
  out.mesh = from.mesh();
  absl::Status s = CheckMeshName(out.mesh, field + ".mesh");
  if (s.ok()) s = ReadMatrix(from.matrix(), field, out.matrix);
  if (!s.ok()) return s;
  out.name = from.name().empty() ? out.mesh : from.name();
  out.label = from.has_label() ? from.label() : number;
  if (out.label == 0u) return Invalid(field + ".label", "must be at least 1");
  out.priority = from.priority();
  if (!from.has_motion()) return absl::OkStatus();
  RigidMotionNumbers& motion = out.motion.emplace();
  s = ReadVec(from.motion().linear(), field + ".motion.linear", motion.linear);
  if (s.ok()) s = ReadVec(from.motion().angular(), field + ".motion.angular", motion.angular);
  if (s.ok()) s = ReadVec(from.motion().center(), field + ".motion.center", motion.center);
  return s;
}

void WriteVec(const Vec3d& v, v1::Vec3& out) {
  out.set_x(v.x);
  out.set_y(v.y);
  out.set_z(v.z);
}

}  // namespace

absl::StatusOr<std::vector<PlacedStored>> ParsePlaced(const v1::PlacedMeshes& message) {
  const auto count = size_t(message.meshes_size());
  if (count < 1 || count > kMaxPlacedMeshes) {
    return Invalid("mesh.placed.meshes", absl::StrCat("1 to ", kMaxPlacedMeshes, " are possible, ", count, " given"));
  }
  std::vector<PlacedStored> meshes(count);
  for (size_t i = 0; i < count; ++i) {
    const absl::Status s =
        Read(message.meshes(int(i)), uint32_t(i + 1), absl::StrCat("mesh.placed.meshes[", i, "]"), meshes[i]);
    if (!s.ok()) return s;
  }
  return meshes;
}

void WriteTo(std::span<const PlacedStored> meshes, v1::PlacedMeshes& message) {
  for (const PlacedStored& from : meshes) {
    v1::PlacedMesh& to = *message.add_meshes();
    to.set_mesh(from.mesh);
    if (!(from.matrix == Mat4d())) {
      for (int i = 0; i < kMatrixNumbers; ++i) to.add_matrix(from.matrix.m[i / 4][i % 4]);
    }
    to.set_name(from.name);
    if (from.label) to.set_label(*from.label);
    to.set_priority(from.priority);
    if (!from.motion) continue;
    WriteVec(from.motion->linear, *to.mutable_motion()->mutable_linear());
    WriteVec(from.motion->angular, *to.mutable_motion()->mutable_angular());
    WriteVec(from.motion->center, *to.mutable_motion()->mutable_center());
  }
}

uint64_t BytesOf(std::span<const PlacedStored> meshes) {
  uint64_t bytes = meshes.size_bytes();
  for (const PlacedStored& placed : meshes) bytes += placed.mesh.size() + placed.name.size();
  return bytes;
}

}  // namespace voxelpipe
