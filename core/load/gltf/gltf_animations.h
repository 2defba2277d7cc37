// Animations of a document.
#pragma once

#include "absl/status/status.h"
#include "load/gltf/document/gltf_buffers.h"
#include "load/gltf/geometry/gltf_accessor.h"
#include "mesh/scene/scene.h"

namespace voxelpipe::gltf {

// In: the document; `scene` with nodes and meshes read. Out: scene.animations, as many as the file's. Channels without
// a target node, or whose path is none of glTF 2.0's four, are left out, as the specification requires. An error in an
// animation (times not finite or not ascending, no keys, a count that does not fit, a node with a matrix, an accessor
// out of range) is stored in its `fault`, INVALID_ARGUMENT or RESOURCE_EXHAUSTED naming animation, sampler or channel,
// and accessor, because most requests use no animation. At most max_nodes animations, channels and samplers in all.
// Errors: RESOURCE_EXHAUSTED for more animations than max_nodes, or for their memory; the job's.
absl::Status ReadAnimations(const Document& document, const AccessorReader& accessors, Budget& budget, Scene& scene);

}  // namespace voxelpipe::gltf
