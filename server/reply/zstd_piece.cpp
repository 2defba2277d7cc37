#include "reply/zstd_piece.h"

#include <zstd.h>

namespace voxelpipe {

void PieceCompressor::Free::operator()(ZSTD_CCtx_s* context) const {
  ZSTD_freeCCtx(context);
}

PieceCompressor::PieceCompressor(int level) : context_(ZSTD_createCCtx()) {
  if (context_) ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, level);
}

PieceCompressor::~PieceCompressor() = default;

std::optional<std::vector<uint8_t>> PieceCompressor::Compress(std::span<const uint8_t> bytes) {
  if (!context_ || bytes.size() < 2) return std::nullopt;
  // One byte less than the original: output that does not fit is not smaller.
  std::vector<uint8_t> frame(bytes.size() - 1);
  const size_t size = ZSTD_compress2(context_.get(), frame.data(), frame.size(), bytes.data(), bytes.size());
  if (ZSTD_isError(size)) return std::nullopt;
  frame.resize(size);
  return frame;
}

}  // namespace voxelpipe
