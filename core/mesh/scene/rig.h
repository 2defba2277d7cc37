// The data to pose a flattened mesh again: hierarchy, skins, animations, and primitives in rest pose.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "mesh/scene/animation.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

struct RigNode {
  Mat4d local;
  Trs trs;
  int64_t parent = -1;          // always before its children in Rig::order
  std::vector<double> weights;  // the file's morph weights of the node's mesh
};

// One MeshPart's source.
struct RigPart {
  std::shared_ptr<const Primitive> primitive;
  uint32_t node = 0;
  int32_t skin = -1;  // -1: the part follows its node
  Mat4d instance;     // EXT_mesh_gpu_instancing, below the node's transform
};

struct Rig {
  std::vector<RigNode> nodes;
  std::vector<uint32_t> order;  // all nodes, parents before children
  std::vector<Skin> skins;
  std::vector<Animation> animations;
  std::vector<RigPart> parts;  // one a part of the TriangleMesh, in its order
};

}  // namespace voxelpipe
