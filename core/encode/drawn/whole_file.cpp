#include "encode/drawn/whole_file.h"

#include <algorithm>
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
      : extension_(extension), path_(std::move(path)), job_(job), encode_(encode), memory_(&MemoryOf(job)) {}

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

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    constexpr size_t kPieceBytes = 8 << 20;  // between two looks at the job
    for (size_t at = 0; at < bytes.size(); at += kPieceBytes) {
      if (absl::Status s = CheckJob(job_); !s.ok()) return s;
      const auto piece = bytes.subspan(at, std::min(kPieceBytes, bytes.size() - at));
      if (absl::Status s = whole_.Write(array, piece); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  absl::Status Commit() override {
    try {
      const VoxelizeResult result = whole_.Take();
      absl::StatusOr<PreviewVolume> volume = PreviewVolume::Build(result, job_);
      if (!volume.ok()) return volume.status();
      if (absl::Status s = memory_.Grow(PreviewColours::MemoryBytes(result), "an index of voxels:"); !s.ok()) return s;
      const PreviewColours colours(result, *volume, job_);
      if (absl::Status s = CheckJob(job_); !s.ok()) return s;
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

absl::StatusOr<uint64_t> CountSolid(const PreviewVolume& volume, const JobContext* job) {
  return SumOfLayers<uint64_t>(volume, job, [&](int64_t k, JobPoll& poll, uint64_t& sum) {
    return volume.VisitRows(k, poll, [&](int64_t, int64_t, uint32_t word) { sum += uint64_t(std::popcount(word)); });
  });
}

uint32_t SrgbCodes(const Vec3f& linear) {
  return uint32_t(LinearToSrgb(linear.x)) << 16 | uint32_t(LinearToSrgb(linear.y)) << 8 | LinearToSrgb(linear.z);
}

}  // namespace voxelpipe
