// Formats whose files begin with what is known last, such as a count or a palette: they are written from whole results.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <bit>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "base/memory_budget.h"
#include "encode/atomic_file.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_volume.h"
#include "encode/result_file.h"
#include "job/job_work.h"

namespace voxelpipe {

// What such a format draws: the solid voxels and their colours, by the rules of RenderPreview (png_preview.h).
struct DrawnResult {
  const VoxelizeResult& result;
  const PreviewVolume& volume;
  const PreviewColours& colours;
  MemoryCharge& memory;  // for what an encoder collects, of MemoryOf(job); has the result already
};

using EncodeWhole = absl::Status (*)(const DrawnResult& drawn, AtomicFile& file, const JobContext* job);

// A writer that collects the result in memory and calls `encode` from Commit. `extension` is that of the format. Errors
// of Begin and Commit: also RESOURCE_EXHAUSTED out of memory. The result and what `encode` collects are charged to
// MemoryOf(job).
std::unique_ptr<ResultFile> MakeWholeFile(std::string_view extension, const std::string& path, const JobContext* job,
                                          EncodeWhole encode);

// Calls visit(i, j, k, n) for the solid voxels in linear order; n is the linear index. `job` may be null, its end ends
// the walk.
template <typename Visit>
absl::Status VisitVoxels(const PreviewVolume& volume, const JobContext* job, const Visit& visit) {
  JobPoll poll(job);
  for (int64_t layer = 0; layer < volume.layers(); ++layer) {
    const int64_t k = volume.Layer(layer);
    const absl::Status s = volume.VisitRows(k, poll, [&](int64_t i, int64_t j, uint32_t word) {
      for (; word != 0; word &= word - 1) {
        const int64_t x = i + std::countr_zero(word);
        visit(x, j, k, volume.Linear(x, j, k));
      }
    });
    if (!s.ok()) return s;
  }
  return absl::OkStatus();
}

// In: add(k, poll, sum), which adds what layer k has and returns the end of the job. Out: the sum over all layers, in
// parallel.
template <typename Sum, typename Add>
absl::StatusOr<Sum> SumOfLayers(const PreviewVolume& volume, const JobContext* job, const Add& add) {
  const Sum sum = tbb::parallel_reduce(
      tbb::blocked_range<int64_t>(0, volume.layers()), Sum{},
      [&](const auto& layers, Sum found) {
        if (!CheckJob(job).ok()) return found;
        JobPoll poll(job);
        for (int64_t layer = layers.begin(); layer < layers.end(); ++layer) {
          if (!add(volume.Layer(layer), poll, found).ok()) break;
        }
        return found;
      },
      std::plus<Sum>());
  if (absl::Status s = CheckJob(job); !s.ok()) return s;
  return sum;
}

// Number of solid voxels.
absl::StatusOr<uint64_t> CountSolid(const PreviewVolume& volume, const JobContext* job);

// sRGB codes of a linear colour, 0xRRGGBB.
uint32_t SrgbCodes(const Vec3f& linear);

}  // namespace voxelpipe
