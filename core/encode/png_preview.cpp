#include "encode/png_preview.h"

#include <algorithm>
#include <new>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/preview/legend.h"
#include "encode/preview/preview_canvas.h"
#include "encode/preview/preview_cells.h"
#include "encode/preview/preview_colour.h"
#include "encode/preview/preview_shade.h"
#include "encode/preview/preview_slice.h"
#include "encode/preview/preview_volume.h"

namespace voxelpipe {
namespace {

absl::StatusOr<Picture> Draw(const VoxelizeResult& result, const PreviewOptions& options, const JobContext* job) {
  absl::StatusOr<PreviewVolume> volume = PreviewVolume::Build(result, job);
  if (!volume.ok()) return volume.status();
  const absl::StatusOr<PreviewCells> cells = PreviewCells::Build(*volume, job);
  if (!cells.ok()) return cells.status();
  const uint64_t pixels = uint64_t(options.width) * uint64_t(options.height);
  MemoryCharge memory(&MemoryOf(job));
  absl::Status status = memory.Grow(pixels, sizeof(Vec3f) + 3, "a picture:");  // the canvas and the result
  if (status.ok()) status = memory.Grow(PreviewColours::MemoryBytes(result), "an index of voxels:");
  if (!status.ok()) return status;
  const PreviewColours colours(result, *volume, job);
  if (status = CheckJob(job); !status.ok()) return status;
  Canvas canvas(options.width, options.height, FromSrgb(0xe9edf1));

  // The view takes the left three quarters, the slices a column at the right.
  const int column = options.width / 4;
  const PixelRect view{0, 0, options.width - column, options.height};
  if (!cells->empty()) {
    status = DrawView(*cells, colours, result.grid, options.view, view, options.samples, job, canvas);
    if (!status.ok()) return status;
  }
  DrawLegend(colours.legend(), view, canvas);
  status = DrawSlices(*volume, colours, result.grid, {view.width, 0, column, options.height}, job, canvas);
  if (!status.ok()) return status;
  Picture picture = canvas.ToPicture(job);
  if (status = CheckJob(job); !status.ok()) return status;
  return picture;
}

}  // namespace

absl::StatusOr<Picture> RenderPreview(const VoxelizeResult& result, const PreviewOptions& options,
                                      const JobContext* job) {
  constexpr int kMaxSide = 16384, kMaxSamples = 8;
  if (std::min(options.width, options.height) < 64 || std::max(options.width, options.height) > kMaxSide) {
    return absl::InvalidArgumentError(absl::StrCat("preview size ", options.width, "x", options.height,
                                                   ": each side takes 64 to ", kMaxSide, " pixels"));
  }
  if (options.samples < 1 || options.samples > kMaxSamples) {
    return absl::InvalidArgumentError(absl::StrCat("preview samples ", options.samples, ": 1 to ", kMaxSamples));
  }
  if (absl::Status status = CheckView(options.view); !status.ok()) return status;
  try {
    return Draw(result, options, job);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while drawing the preview");
  }
}

absl::Status WritePreview(const VoxelizeResult& result, const std::string& path, const PreviewOptions& options,
                          const JobContext* job) {
  // Opens the file first: an unwritable path should not cost a rendering.
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(path, job);
  if (!file.ok()) return file.status();
  const absl::StatusOr<Picture> picture = RenderPreview(result, options, job);
  if (!picture.ok()) return picture.status();
  try {
    MemoryCharge memory(&MemoryOf(job));
    const uint64_t bytes = picture->rgb.size() + PngMemoryBytes(picture->width, picture->height);
    if (absl::Status status = memory.Grow(bytes, "a picture:"); !status.ok()) return status;
    const absl::StatusOr<std::vector<uint8_t>> png = EncodePng(*picture, job);
    if (!png.ok()) return png.status();
    if (absl::Status status = file->Write(*png, job); !status.ok()) return status;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("out of memory while writing '", path, "'"));
  }
  return file->Commit();
}

}  // namespace voxelpipe
