// One glTF primitive -> one triangle list with its attributes.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "load/gltf_accessor.h"
#include "load/gltf_buffers.h"
#include "mesh/scene.h"

namespace tinygltf {
struct Primitive;
}

namespace voxelpipe::gltf {

// What reading a primitive needs; all must outlive the calls.
struct PrimitiveContext {
  const Document& document;
  Buffers& buffers;
  Budget& budget;
  const AccessorReader& accessors;
  std::vector<std::string>& warnings;
};

// In: a checked primitive and the weights of its morph targets (missing ones are 0). Out: the primitive, or nothing if
// it draws no triangles (points, lines, no POSITION; a warning where that is a fault).
// Errors: INVALID_ARGUMENT naming accessor, primitive (`where`) and vertex or position; RESOURCE_EXHAUSTED.
absl::StatusOr<std::optional<Primitive>> ReadPrimitive(const tinygltf::Primitive& primitive,
                                                       const std::vector<double>& weights, const std::string& where,
                                                       PrimitiveContext& context);

}  // namespace voxelpipe::gltf
