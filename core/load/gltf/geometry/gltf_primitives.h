// One glTF primitive -> one triangle list with its attributes.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "load/gltf/document/gltf_buffers.h"
#include "load/gltf/geometry/gltf_accessor.h"
#include "load/gltf/geometry/gltf_draco.h"
#include "mesh/scene/scene.h"

namespace tinygltf {
struct Primitive;
}

namespace voxelpipe::gltf {

// The context for reading primitives; all must outlive the calls.
struct PrimitiveContext {
  const Document& document;
  Buffers& buffers;
  Budget& budget;
  const AccessorReader& accessors;
  WarningList& warnings;
  DracoAhead* draco = nullptr;  // set while meshes are read
};

// The stream of a primitive's KHR_draco_mesh_compression, empty if it has no such extension or draws no triangles.
// Errors: INVALID_ARGUMENT naming `where` and the buffer view.
absl::StatusOr<std::optional<std::span<const uint8_t>>> DracoStream(const tinygltf::Primitive& primitive,
                                                                    const std::string& where,
                                                                    PrimitiveContext& context);

// In: a checked primitive and the weights of its morph targets (missing ones are 0). Out: the primitive; empty if it
// draws no triangles (points, lines, no POSITION; with a warning if that is a fault). Errors: INVALID_ARGUMENT naming
// accessor, primitive (`where`) and vertex or position; RESOURCE_EXHAUSTED.
absl::StatusOr<std::optional<Primitive>> ReadPrimitive(const tinygltf::Primitive& primitive,
                                                       const std::vector<double>& weights, const std::string& where,
                                                       PrimitiveContext& context);

}  // namespace voxelpipe::gltf
