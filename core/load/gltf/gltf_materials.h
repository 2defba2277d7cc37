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

// In: the model and the image declarations. Out: scene.materials, scene.textures, scene.images (still encoded).
// Appearance never makes a file fail: what cannot be used is left at its default, and image or reference say why (their
// `fault`).
// Errors: RESOURCE_EXHAUSTED, the job's.
absl::Status ReadMaterials(const tinygltf::Model& model, const Document& document, Buffers& buffers, Budget& budget,
                           Scene& scene);

}  // namespace voxelpipe::gltf
