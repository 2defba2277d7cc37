// Vertex data of meshes that Draco is to encode.
#pragma once

#include <draco/mesh/mesh.h>

#include <vector>

#include "base/vec.h"

namespace voxelpipe::testing {

// Adds an attribute with one vector a point. Out: its number in the mesh.
inline int AddVectors(draco::Mesh& mesh, draco::GeometryAttribute::Type type, const std::vector<Vec3f>& values) {
  draco::GeometryAttribute attribute;
  attribute.Init(type, nullptr, 3, draco::DT_FLOAT32, false, 3 * sizeof(float), 0);
  const int id = mesh.AddAttribute(attribute, true, uint32_t(values.size()));
  for (size_t i = 0; i < values.size(); ++i) {
    mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(uint32_t(i)), &values[i]);
  }
  return id;
}

}  // namespace voxelpipe::testing
