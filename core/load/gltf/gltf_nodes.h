// Nodes, skins, instancing and the scene to be flattened.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "load/gltf/geometry/gltf_accessor.h"
#include "mesh/scene/scene.h"

namespace tinygltf {
class Model;
}

namespace voxelpipe::gltf {

// In: a checked model. Out: scene.nodes, scene.skins and scene.roots. The hierarchy is proved to be a forest: no node
// has two parents or is its own ancestor, and no node lies deeper than max_node_depth; nothing here recurses. Roots are
// those of the default scene, or of scene 0 if there is no default; none (with a warning) without scenes. A node hidden
// by KHR_node_visibility and all its descendants have no mesh. Errors: INVALID_ARGUMENT naming the node;
// RESOURCE_EXHAUSTED naming the limit.
absl::Status ReadNodes(const tinygltf::Model& model, const AccessorReader& accessors, Budget& budget, Scene& scene);

// Adds missing nodes, after everything else is read: a node for each mesh if the file has neither scenes nor nodes
// (with a warning), and a root above all others with CESIUM_RTC's centre. RESOURCE_EXHAUSTED past max_nodes.
absl::Status AddMissingNodes(const Document& document, const LoadLimits& limits, Scene& scene);

}  // namespace voxelpipe::gltf
