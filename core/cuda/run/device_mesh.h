// The shaded mesh of a run on the device.
#pragma once

#include <memory>
#include <vector>

#include "cuda/device/buffer.h"
#include "cuda/device/mesh_cache.h"
#include "cuda/primitives/views.h"
#include "cuda/primitives/voxel_code.h"

namespace voxelpipe {
struct PackedVertex;
}

namespace voxelpipe::cuda {

// Arrays of the shaded mesh on the device, and the view of them that is passed to shaders.
struct DeviceMesh {
  DeviceArray<Vec3d> positions, index_positions;
  DeviceArray<VertexCode> codes;  // per vertex (voxel_code.h)
  DeviceArray<Vec3f> normals, velocities;
  DeviceArray<Vec4f> tangents, colors;
  DeviceArray<Vec2f> uv[2];
  DeviceArray<uint32_t> triangles;  // three indices per triangle
  DeviceArray<uint32_t> by_parts;   // the same in the order of parts (PartState), if that is another one
  DeviceArray<PartView> parts;
  DeviceArray<MaterialView> materials;
  DeviceArray<TextureView> textures;
  DeviceArray<AttributeView> attributes;
  std::vector<DeviceArray<float>> attribute_values;
  std::vector<DeviceArray<AttributeRun>> attribute_runs;
  std::vector<DeviceArray<uint8_t>> images;  // texels of level 0
  std::vector<DeviceArray<Vec4f>> mips;      // further levels
  MeshView host_view;                        // pointers into device memory
  DeviceArray<MeshView> view;                // the same on the device, one element
  bool as_loaded = false;                    // positions are those of the loaded mesh

  const uint32_t* triangle_list() const {
    return host_view.triangles == nullptr ? nullptr : &host_view.triangles[0][0];
  }
};

struct LargestTriangles;
// Copies of a spatially incoherent mesh that rasterizers read instead of its arrays (mesh_locality.h); null: not used.
struct ScatteredMesh {
  // Three vertices per triangle, quantized relative to RunState::box, so that no index lookup is needed. The box's
  // extent is kept here (fixed_point.h).
  const PackedVertex* packed = nullptr;
  // The same, sorted by Morton code (Morton, 1966), for passes that do not depend on triangle order.
  const PackedVertex* placed = nullptr;
  const LargestTriangles* largest = nullptr;
  Vec3d extent;
  std::shared_ptr<const CachedArray> kept;  // owner of both copies: the mesh cache, or
  DeviceArray<uint8_t> own;                 // this run, if no other run has the same mesh and box
  bool tried = false;                       // an attempt was made

  // The stream's work must be done.
  void Drop() {
    packed = placed = nullptr;
    largest = nullptr;
    kept.reset();
    own.Free();
  }
};

}  // namespace voxelpipe::cuda
