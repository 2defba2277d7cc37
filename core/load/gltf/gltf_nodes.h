// Nodes, skins, instancing and the scene that is to be flattened.
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
// has two parents or is its own ancestor, and no node lies deeper than max_node_depth; nothing here recurses.
// Roots are those of the default scene, of scene 0 where none is the default; none (with a warning) without scenes.
// A node that KHR_node_visibility hides loses its mesh, and so do the nodes below it.
// Errors: INVALID_ARGUMENT naming the node; RESOURCE_EXHAUSTED naming the limit.
absl::Status ReadNodes(const tinygltf::Model& model, const AccessorReader& accessors, Budget& budget, Scene& scene);

// Once all else is read, what the file has no nodes for: a node for each mesh where there is neither a scene nor a node
// (with a warning), and one above all roots that holds CESIUM_RTC's centre. RESOURCE_EXHAUSTED past max_nodes.
absl::Status AddMissingNodes(const Document& document, const LoadLimits& limits, Scene& scene);

}  // namespace voxelpipe::gltf
