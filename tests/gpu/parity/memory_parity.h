// Runs for which a device has little memory, or none, and what it keeps.
#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "gpu/cases/parity_cases.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::gpu {

// "RESOURCE_EXHAUSTED: ...".
std::string Message(const absl::Status& status);

// Filled parts in eight layers: slabs cannot be thinner.
ParityCase CaseOfRanges();
// Runs that case with less and less device memory. The crossings of all its rows take more than one has: they are taken
// in ranges of rows, with the CPU's bytes, until one row has no room, which is RESOURCE_EXHAUSTED. Out: what is wrong.
// `mesh`: some 300 parts in nearly every row, whose crossings take 3 MB.
std::optional<std::string> RowsInRanges(const TriangleMesh& mesh, ParityCase c);

// Requests for more than any device has, and for more than the backend counts: marked for another one to try, and what
// comes after them works. Out: what is wrong; in `refusal` what the first one gave.
std::optional<std::string> MoreThanDevicesHave(std::string& refusal);

// A mesh that the device keeps, two of whose textures have one image: texels and levels go up once, and every run gives
// the CPU's bytes. Out: what is wrong.
std::optional<std::string> TextureOfKeptMesh();

}  // namespace voxelpipe::gpu
