// Stored meshes that are placed on one grid <-> messages.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "voxelpipe/v1/request.pb.h"
#include "wire/placed_stored.h"

namespace voxelpipe {

// Out: the list with the default of each name and label, and 0 for -0 in matrices: equal requests give equal lists.
// Errors: INVALID_ARGUMENT "mesh.placed.meshes[3].matrix[5]: why" for no mesh, more than kMaxPlacedMeshes, what
// CheckMeshName and CheckPlacement refuse, another number of numbers than 16, a label of 0, and a motion that is not
// finite.
absl::StatusOr<std::vector<PlacedStored>> ParsePlaced(const v1::PlacedMeshes& message);

// The inverse; defaults are left out.
void WriteTo(std::span<const PlacedStored> meshes, v1::PlacedMeshes& message);

// The memory of a list.
uint64_t BytesOf(std::span<const PlacedStored> meshes);

}  // namespace voxelpipe
