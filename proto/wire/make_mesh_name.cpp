// Apart from mesh_name.cpp: the module of Python checks names and makes none, and should not need OpenSSL for it.
#include "absl/strings/str_cat.h"
#include "base/checksum/sha256.h"
#include "wire/mesh_name.h"

namespace voxelpipe {

std::string MeshNameOf(std::span<const uint8_t> bytes, const MeshFileType& type) {
  std::string name = absl::StrCat(std::string(kMeshCollection), Sha256Hex(bytes));
  if (type.unit != LengthUnit::kNone) absl::StrAppend(&name, "-", std::string(Name(type.unit)));
  if (type.format != MeshFormat::kAuto) absl::StrAppend(&name, "-", std::string(Name(type.format)));
  return name;
}

}  // namespace voxelpipe
