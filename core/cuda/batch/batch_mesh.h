// A member's mesh on the device: cached arrays, and arrays uploaded with the pass.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "cuda/batch/batch_member.h"
#include "cuda/device/mesh_cache.h"
#include "cuda/device/upload_layout.h"

namespace voxelpipe::cuda {

// Cached device arrays of all members. Must live until the pass's work is done.
class KeptArrays {
 public:
  KeptArrays(int ordinal, cudaStream_t stream) : ordinal_(ordinal), stream_(stream) {}
  int ordinal() const { return ordinal_; }
  // The cached array with a key derived from the mesh's id; uploads it if it is missing.
  absl::StatusOr<const uint8_t*> Find(const std::string& key, const void* from, uint64_t bytes);

 private:
  const int ordinal_;
  const cudaStream_t stream_;
  std::vector<PinnedBuffer> staged_;
  std::vector<std::shared_ptr<const CachedArray>> arrays_;
};

class BatchMesh {
 public:
  // Adds the arrays that the member's stages read and that are not cached to `layout`. `member` and this object must
  // live until the layout is copied.
  absl::Status Add(const BatchMember& member, KeptArrays& kept, UploadLayout& layout);
  // Call when the layout's block has its address. `index_positions`: where the pass stores the vertices in index space,
  // of a grid with these dims.
  void Place(const uint8_t* block, const Vec3d* index_positions, const std::array<int64_t, 3>& grid_dims);

  // On the device; valid after Place.
  const Vec3d* positions() const { return positions_there_; }
  const uint32_t* triangles() const { return triangles_there_; }
  const MeshView* view() const { return view_there_; }  // null unless the member is shaded

 private:
  // An array on the device: cached, or at an offset in the block.
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
  void PlaceShading(const uint8_t* block, const Vec3d* index_positions, const std::array<int64_t, 3>& grid_dims);

  // Inputs of fragment shaders besides positions and triangles. Pointers within lists are replaced by device addresses.
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
  std::unique_ptr<Shading> shading_;  // null unless the member is shaded
};

}  // namespace voxelpipe::cuda
