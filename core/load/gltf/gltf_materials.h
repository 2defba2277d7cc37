// Materials, textures and images.
#pragma once

#include "absl/status/status.h"
#include "load/gltf/document/gltf_buffers.h"
#include "load/gltf/document/gltf_document.h"
#include "mesh/scene/scene.h"

namespace tinygltf {
class Model;
}

namespace voxelpipe::gltf {

// In: the model and the image declarations. Out: scene.materials, scene.textures, scene.images (still encoded). Faults
// of appearance never fail a file: unusable parts keep their defaults, and the image or reference says why (its
// `fault`). Errors: RESOURCE_EXHAUSTED, the job's.
absl::Status ReadMaterials(const tinygltf::Model& model, const Document& document, Buffers& buffers, Budget& budget,
                           Scene& scene);

}  // namespace voxelpipe::gltf
