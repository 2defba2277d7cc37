// The targets of a tile that want the same fragments: shades these in batches and blends them.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "cpu/base/part_cursor.h"
#include "cpu/run_state.h"
#include "cpu/shading/batch_shader.h"
#include "cpu/tile_buffer.h"

namespace voxelpipe::cpu {

// Which fragments of a voxel a target blends. Those that keep only one are shaded for it alone: a tile's triangles come
// in the order in which the first fragment in a voxel wins.
enum class Wanted : uint8_t { kAll, kFirst, kLast };

class ShadedTargets {
 public:
  // The targets of `state` that want these fragments. `buffers`: of all targets; outlives this.
  ShadedTargets(const RunState& state, Wanted wanted, std::vector<TileBuffer>& buffers);

  bool empty() const { return targets_ == 0; }

  void BeginTile(const int64_t (&origin)[3]);
  // A triangle's fragments in the tile.
  void Add(uint32_t triangle, std::span<const TileSpan> spans);
  // Shades and blends what was added.
  void Flush();

 private:
  void EnterPartOf(uint32_t triangle);
  // For the targets whose fragments of a triangle all have the same output: shades once, blends span by span.
  void BlendSame(uint32_t triangle, std::span<const TileSpan> spans);
  FragmentInput InputOf(uint32_t triangle) const;
  // The voxels that all targets have.
  void FindTaken();

  const RunState& state_;
  const bool winners_;  // of each voxel the first fragment in the order of the triangles is wanted
  std::vector<TileBuffer>& buffers_;
  std::vector<std::optional<BuiltInShader>> shaders_;  // by target
  ShaderTraits traits_;                                // the union of their traits
  uint32_t targets_ = 0;                               // a bit each
  // Of the part whose triangles come.
  PartCursor part_;
  uint32_t same_ = 0, varying_ = 0;  // targets
  bool may_discard_ = false;
  // Of the tile.
  std::array<uint32_t, kTileRows> taken_{};  // winners_: voxels of which no further fragment is wanted
  FragmentBatch batch_;
  ShadedBatch shaded_;
};

}  // namespace voxelpipe::cpu
