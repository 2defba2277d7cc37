#include "load/gltf/geometry/gltf_draco.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>

#include "base/limit_error.h"

namespace voxelpipe::gltf {
namespace {

// Bytes of compressed streams decoded together: bounds the memory of decoded streams that wait.
constexpr uint64_t kMaxBytesAhead = 4 << 20;

}  // namespace

absl::StatusOr<DracoMesh> DracoAhead::Take(std::span<const uint8_t> bytes) {
  const bool next =
      taken_ < streams_.size() && streams_[taken_].data() == bytes.data() && streams_[taken_].size() == bytes.size();
  if (absl::Status over = job_.Check(); !over.ok()) return over;
  if (!next) return DecodeDraco(job_, bytes, limits_);
  if (ready_.empty()) DecodeSome();
  Decoded decoded = std::move(ready_.front());
  ready_.pop_front();
  ++taken_;
  // Decoded alone it may fit even if several together did not.
  if (LimitErrorOf(decoded.status)) return DecodeDraco(job_, bytes, limits_);
  if (!decoded.status.ok()) return decoded.status;
  return std::move(decoded.mesh);
}

void DracoAhead::DecodeSome() {
  const auto most = 2 * static_cast<size_t>(tbb::this_task_arena::max_concurrency());
  size_t count = 0;
  for (uint64_t bytes = 0; count < std::min(most, streams_.size() - taken_); ++count) {
    bytes += streams_[taken_ + count].size();
    if (count > 0 && bytes > kMaxBytesAhead) break;
  }
  ready_.resize(count);
  tbb::parallel_for(size_t{0}, count, [&](size_t i) {
    if (ready_[i].status = job_.Check(); !ready_[i].status.ok()) return;
    absl::StatusOr<DracoMesh> mesh = DecodeDraco(job_, streams_[taken_ + i], limits_);
    if (mesh.ok()) {
      ready_[i].mesh = *std::move(mesh);
    } else {
      ready_[i].status = mesh.status();
    }
  });
}

}  // namespace voxelpipe::gltf
