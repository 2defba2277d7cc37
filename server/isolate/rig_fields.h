// The fields of a rig, for archives (archive.h).
#pragma once

#include <memory>

#include "isolate/archive.h"
#include "mesh/scene/rig.h"

namespace voxelpipe {

// A rig or null. Primitives and morph data that several parts share are sent once.
void RigFields(ArchiveWriter& archive, const std::shared_ptr<const Rig>& rig);
// Values that were read must pass CheckMesh (mesh/health/check_mesh.h) after Finish.
void RigFields(ArchiveReader& archive, std::shared_ptr<const Rig>& rig);

}  // namespace voxelpipe
