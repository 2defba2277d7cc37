// Formats whose files begin with what is known last, such as a count or a palette: they are written from whole results.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "base/memory_budget.h"
#include "encode/atomic_file.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_volume.h"
#include "encode/result_file.h"

namespace voxelpipe {

// What such a format draws: the solid voxels and their colours, by the rules of RenderPreview (png_preview.h).
struct DrawnResult {
  const VoxelizeResult& result;
  const PreviewVolume& volume;
  const PreviewColours& colours;
  MemoryCharge& memory;  // for what an encoder collects; has the result already
};

using EncodeWhole = absl::Status (*)(const DrawnResult& drawn, AtomicFile& file, const JobContext* job);

// A writer that collects the result in memory and calls `encode` from Commit. `extension` is that of the format. Errors
// of Begin and Commit: also RESOURCE_EXHAUSTED out of memory. The result and what `encode` collects are charged to
// MemoryOf(*job).
std::unique_ptr<ResultFile> MakeWholeFile(std::string_view extension, const std::string& path, const JobContext* job,
                                          EncodeWhole encode);

// Calls visit(i, j, n) for the solid voxels of layer k in linear order; n is the linear index.
template <typename Visit>
void VisitLayer(const PreviewVolume& volume, int64_t k, const Visit& visit) {
  const auto& dims = volume.dims();
  for (int64_t j = 0; j < dims[1]; ++j) {
    for (int64_t i = 0; i < dims[0]; i += 32) {
      for (uint32_t word = volume.Row(i, j, k, 32); word != 0; word &= word - 1) {
        const int64_t x = i + __builtin_ctz(word);
        visit(x, j, volume.Linear(x, j, k));
      }
    }
  }
}

// The same for all layers, visit(i, j, k, n); `job` may be null, its end ends the walk.
template <typename Visit>
absl::Status VisitVoxels(const PreviewVolume& volume, const JobContext* job, const Visit& visit) {
  for (int64_t k = 0; k < volume.dims()[2]; ++k) {
    if (job != nullptr) {
      if (absl::Status s = job->Check(); !s.ok()) return s;
    }
    VisitLayer(volume, k, [&](int64_t i, int64_t j, uint64_t n) { visit(i, j, k, n); });
  }
  return absl::OkStatus();
}

// Number of solid voxels.
uint64_t CountSolid(const PreviewVolume& volume);

// sRGB codes of a linear colour, 0xRRGGBB.
uint32_t SrgbCodes(const Vec3f& linear);

}  // namespace voxelpipe
