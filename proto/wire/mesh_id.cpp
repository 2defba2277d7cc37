#include "wire/mesh_id.h"

#include "base/checksum/sha256.h"

namespace voxelpipe {

std::string MeshIdOf(std::span<const uint8_t> bytes, LengthUnit unit) {
  std::string id = Sha256Hex(bytes);
  if (unit == LengthUnit::kNone) return id;
  id += ':';
  id += Name(unit);
  return Sha256Hex({reinterpret_cast<const uint8_t*>(id.data()), id.size()});
}

}  // namespace voxelpipe
