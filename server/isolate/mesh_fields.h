// The fields of a mesh and of the data loaded with it, for archives (archive.h).
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "isolate/archive.h"
#include "load/load_mesh.h"
#include "mesh/scene/load_limits.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Code, text and payloads.
void Fields(ArchiveWriter& archive, const absl::Status& status);
void Fields(ArchiveReader& archive, absl::Status& status);

// All of a mesh except its content_id and its charges. Null images stay null; shared images, primitives and morph data
// are sent once.
void Fields(ArchiveWriter& archive, const TriangleMesh& mesh);
// Values that were read must pass CheckMesh (mesh/health/check_mesh.h) after Finish.
void Fields(ArchiveReader& archive, TriangleMesh& mesh);

// Parts, materials, textures and images alone: the data that PrepareTexturesFor reads and changes.
void TextureFields(ArchiveWriter& archive, const TriangleMesh& mesh);
void TextureFields(ArchiveReader& archive, TriangleMesh& mesh);

void Fields(ArchiveWriter& archive, const LoadedMesh& loaded);
void Fields(ArchiveReader& archive, LoadedMesh& loaded);

}  // namespace voxelpipe
