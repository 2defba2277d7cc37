// MeshContents <-> its message.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "mesh/contents.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// `stages`: wall milliseconds of "load" and "flatten". Names of attributes come from untrusted files: they are
// sanitized (base/text.h), and at most 256 are listed.
v1::MeshContents ToMessage(const MeshContents& contents, const std::vector<std::pair<std::string, double>>& stages);
MeshContents FromMessage(const v1::MeshContents& message);

}  // namespace voxelpipe
