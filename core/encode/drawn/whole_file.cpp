#include "encode/drawn/whole_file.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <functional>
#include <new>
#include <optional>

#include "absl/strings/str_cat.h"
#include "encode/format_registry.h"
#include "job/memory_sink.h"
#include "shaders/texture/srgb.h"

namespace voxelpipe {
namespace {

class WholeFile final : public ResultFile {
 public:
  WholeFile(std::string_view extension, std::string path, const JobContext* job, EncodeWhole encode)
      : extension_(extension),
        path_(std::move(path)),
        job_(job),
        encode_(encode),
        memory_(job == nullptr ? nullptr : &MemoryOf(*job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(extension_, header.kind, header.specs.size()); !s.ok()) return s;
    for (const ArraySpec& array : header.arrays) {
      if (absl::Status s = memory_.Grow(array.bytes(), "the result of a file:"); !s.ok()) return s;
    }
    // Created first: a path that cannot be written should not cost the result.
    absl::StatusOr<AtomicFile> file = path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path_, job_);
    if (!file.ok()) return file.status();
    file_.emplace(*std::move(file));
    return whole_.Begin(header);
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override { return whole_.Write(array, bytes); }

  absl::Status Commit() override {
    try {
      const VoxelizeResult result = whole_.Take();
      absl::StatusOr<PreviewVolume> volume = PreviewVolume::Build(result, job_);
      if (!volume.ok()) return volume.status();
      const PreviewColours colours(result, *volume);
      if (absl::Status s = encode_({result, *volume, colours, memory_}, *file_, job_); !s.ok()) return s;
    } catch (const std::bad_alloc&) {
      return absl::ResourceExhaustedError(absl::StrCat("out of memory while writing '", path_, "'"));
    }
    return file_->Commit();
  }

 private:
  std::string_view extension_;
  std::string path_;
  const JobContext* job_;
  EncodeWhole encode_;
  std::optional<AtomicFile> file_;
  MemoryCharge memory_;
  MemorySink whole_;
};

}  // namespace

std::unique_ptr<ResultFile> MakeWholeFile(std::string_view extension, const std::string& path, const JobContext* job,
                                          EncodeWhole encode) {
  return std::make_unique<WholeFile>(extension, path, job, encode);
}

uint64_t CountSolid(const PreviewVolume& volume) {
  return tbb::parallel_reduce(
      tbb::blocked_range<int64_t>(0, volume.dims()[2]), uint64_t{0},
      [&](const auto& layers, uint64_t count) {
        for (int64_t k = layers.begin(); k < layers.end(); ++k) {
          for (int64_t j = 0; j < volume.dims()[1]; ++j) {
            for (int64_t i = 0; i < volume.dims()[0]; i += 32) {
              count += uint64_t(__builtin_popcount(volume.Row(i, j, k, 32)));
            }
          }
        }
        return count;
      },
      std::plus<uint64_t>());
}

uint32_t SrgbCodes(const Vec3f& linear) {
  return uint32_t(LinearToSrgb(linear.x)) << 16 | uint32_t(LinearToSrgb(linear.y)) << 8 | LinearToSrgb(linear.z);
}

}  // namespace voxelpipe
