// Small files that need much memory and time, each of another kind.
#pragma once

#include <cstdint>

#include "support/meshes/glb_builder.h"

namespace voxelpipe::testing {

// `count` instances of a triangle from an accessor without data.
ByteVector InstancesWithoutData(uint64_t count);
// `count` instances, each with `primitives` primitives that draw nothing, from an accessor without data.
ByteVector EmptyPrimitivesWithoutData(int primitives, uint64_t count);
// `count` primitives of one triangle, each with an attribute of its own name.
ByteVector ManyOwnAttributes(int count);
// `images` textures that are one PNG of edge x edge texels in one buffer view, of which the materials of as many
// triangles use all.
ByteVector LargePngs(uint32_t edge, int images);
// A triangle with a texture, a PNG of one texel with `texts` compressed texts of 7 MB each.
ByteVector PngWithTexts(int texts);
// One mesh of `primitives` without attributes and one with a morph target without data, in `nodes` nodes with weights
// of their own.
ByteVector PrimitivesWithoutData(int primitives, int nodes);
// A mesh of `weights` morph weights, in `nodes` nodes, and an empty animation, which gives the scene a rig.
ByteVector WeightsOfManyNodes(int weights, int nodes);
// `instances` of a triangle with `targets` morph targets, all without data.
ByteVector TargetsWithoutData(int targets, uint64_t instances);
// `materials`, each with `numbers` numbers in a member of an extension that is read.
ByteVector NumbersOfMaterials(int materials, int numbers, const std::string& member);
// `skins` of `joints` joints, which are one node.
ByteVector JointsWithoutData(int skins, int joints);
// JSON of about `bytes` bytes: empty objects in the array `member` of the document.
ByteVector EmptyObjects(uint64_t bytes, const std::string& member);

}  // namespace voxelpipe::testing
