// Compression of the pieces of a result.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

struct ZSTD_CCtx_s;

namespace voxelpipe {

// Reuses zstd's working memory. Not thread-safe.
class PieceCompressor {
 public:
  // `level`: 1 (fast) to 19.
  explicit PieceCompressor(int level);
  ~PieceCompressor();

  // `bytes` as one zstd frame, which declares its size; empty if that is not smaller, or if memory is short.
  std::optional<std::vector<uint8_t>> Compress(std::span<const uint8_t> bytes);

 private:
  struct Free {
    void operator()(ZSTD_CCtx_s* context) const;
  };
  const std::unique_ptr<ZSTD_CCtx_s, Free> context_;
};

}  // namespace voxelpipe
