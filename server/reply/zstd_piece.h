// Compression of the pieces of a result.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

struct ZSTD_CCtx_s;

namespace voxelpipe {

// Keeps zstd's working memory between pieces. Not thread-safe.
class PieceCompressor {
 public:
  // `level`: 1 (fast) to 19.
  explicit PieceCompressor(int level);
  ~PieceCompressor();

  // `bytes` as one zstd frame, which states its size; nothing where that is not smaller, or memory is missing.
  std::optional<std::vector<uint8_t>> Compress(std::span<const uint8_t> bytes);

 private:
  struct Free {
    void operator()(ZSTD_CCtx_s* context) const;
  };
  const std::unique_ptr<ZSTD_CCtx_s, Free> context_;
};

}  // namespace voxelpipe
