// Files of a few bytes that ask for much memory and time, each of another kind.
#pragma once

#include <cstdint>

#include "support/glb_builder.h"

namespace voxelpipe::testing {

// `count` instances of a triangle from an accessor without data.
ByteVector InstancesWithoutData(uint64_t count);
// `count` instances, each of `primitives` that draw nothing, from an accessor without data.
ByteVector EmptyPrimitivesWithoutData(int primitives, uint64_t count);
// `count` primitives of one triangle, each with an attribute of its own name.
ByteVector ManyOwnAttributes(int count);
// `images` textures that are one PNG of edge x edge texels in one buffer view, of which the materials of as many triangles use all.
ByteVector LargePngs(uint32_t edge, int images);
// JSON of about so many bytes: empty objects in the array `member` of the document.
ByteVector EmptyObjects(uint64_t bytes, const std::string& member);

}  // namespace voxelpipe::testing
