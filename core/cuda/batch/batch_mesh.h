// A member's mesh on the device: what the device keeps of it, and what goes up with the pass.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cuda/batch/batch_member.h"
#include "cuda/device/mesh_cache.h"
#include "cuda/device/upload_layout.h"

namespace voxelpipe::cuda {

// The arrays that the device keeps, of all members. Must live until the pass's work is done.
class KeptArrays {
 public:
  KeptArrays(int ordinal, cudaStream_t stream) : ordinal_(ordinal), stream_(stream) {}
  int ordinal() const { return ordinal_; }
  // The device's copy of an array that a mesh's id names, made if there is none.
  absl::StatusOr<const uint8_t*> Find(const std::string& key, const void* from, uint64_t bytes);

 private:
  const int ordinal_;
  const cudaStream_t stream_;
  std::vector<PinnedBuffer> staged_;
  std::vector<std::shared_ptr<const CachedArray>> arrays_;
};

class BatchMesh {
 public:
  // Adds to `layout` what of the mesh the member's stages read and the device does not keep. `member` and this object
  // must live until the layout was copied.
  absl::Status Add(const BatchMember& member, KeptArrays& kept, UploadLayout& layout);
  // Once the layout's block has its place. `index_positions`: where the pass puts the vertices in index space.
  void Place(const uint8_t* block, const Vec3d* index_positions);

  // On the device; after Place.
  const Vec3d* positions() const { return positions_there_; }
  const uint32_t* triangles() const { return triangles_there_; }
  const MeshView* view() const { return view_there_; }  // of a member that is shaded; else null

 private:
  // An array on the device: there already, or in the block.
  template <typename T>
  struct Array {
    const T* kept = nullptr;
    uint64_t at = 0;
    bool in_block = false;
    const T* On(const uint8_t* block) const { return in_block ? reinterpret_cast<const T*>(block + at) : kept; }
  };
  template <typename T>
  absl::Status AddArray(const std::string& key, const T* from, uint64_t count, KeptArrays& kept, UploadLayout& layout,
                        Array<T>& array);
  template <typename T>
  void AddToBlock(const T* from, uint64_t count, UploadLayout& layout, Array<T>& array);
  absl::Status AddShading(const BatchMember& member, KeptArrays& kept, UploadLayout& layout);
  void AddTextures(UploadLayout& layout);
  void PlaceShading(const uint8_t* block, const Vec3d* index_positions);

  // What fragment shaders read besides positions and triangles. Lists show arrays; they are changed to where those are.
  struct Shading {
    MeshView view;
    uint64_t view_at = 0;
    Array<Vec3f> normals, velocities;
    Array<Vec4f> tangents, colors;
    Array<Vec2f> uv[2];
    Array<PartView> parts;
    Array<MaterialView> materials;
    Array<TextureView> textures;
    Array<AttributeView> attributes;
    std::vector<TextureView> texture_list;
    std::vector<Array<uint8_t>> images;
    std::vector<Array<Vec4f>> mips;
    std::vector<AttributeView> attribute_list;
    std::vector<Array<float>> values;
    std::vector<Array<AttributeRun>> runs;
  };

  Array<Vec3d> positions_;
  Array<uint32_t> triangles_;
  const Vec3d* positions_there_ = nullptr;
  const uint32_t* triangles_there_ = nullptr;
  const MeshView* view_there_ = nullptr;
  std::unique_ptr<Shading> shading_;  // of a member that is shaded
};

}  // namespace voxelpipe::cuda
