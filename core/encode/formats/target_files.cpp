// .raw and .npy: one file a target; .raw with a description.
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/encode.h"
#include "encode/format_registry.h"
#include "encode/formats/writers.h"
#include "encode/npy.h"
#include "encode/part_json.h"
#include "encode/raw_description.h"
#include "job/job_work.h"
#include "job/part_receiver.h"

namespace voxelpipe {
namespace {

class TargetFiles final : public ResultFile {
 public:
  TargetFiles(std::string path, bool npy, const JobContext* job)
      : path_(std::move(path)), npy_(npy), job_(job), memory_(&MemoryOf(job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    std::vector<ArraySpec> arrays = header.arrays;
    arrays.resize(header.specs.size());
    if (absl::Status s = CheckHolds(npy_ ? ".npy" : ".raw", header.kind, header.specs.size()); !s.ok()) return s;
    header_ = header;
    if (!npy_ && !path_.empty()) {  // of the description
      const uint64_t bytes = PartReceiver::MemoryBytes(header) + PartsJsonBytes(header.parts());
      if (absl::Status s = memory_.Grow(bytes, "the parts of a file:"); !s.ok()) return s;
      parts_.Begin(header);
    }
    if (path_.empty() && arrays.size() != 1) {
      return absl::InvalidArgumentError(
          absl::StrCat("standard output: ", arrays.size(), " targets go into an .npz, not into one .npy or .raw"));
    }
    paths_ = OutputPaths(path_, arrays.size());
    for (size_t i = 0; i < arrays.size(); ++i) {
      absl::StatusOr<AtomicFile> file = Open(paths_[i]);
      if (!file.ok()) return file.status();
      files_.push_back(*std::move(file));
      uint64_t count = 1;
      for (const uint64_t n : arrays[i].shape) count *= n;
      elements_.emplace_back(arrays[i].type, count);
      if (!npy_) continue;
      absl::Status s = memory_.Grow(NpyElements::MemoryBytes(arrays[i].type, count), "elements of a file:");
      if (!s.ok()) return s;
      const std::string head = NpyHeader(NpyDescr(arrays[i].type), arrays[i].shape);
      s = files_.back().Write({reinterpret_cast<const uint8_t*>(head.data()), head.size()}, job_);
      if (!s.ok()) return s;
    }
    if (npy_ || path_.empty()) return absl::OkStatus();
    absl::StatusOr<AtomicFile> file = AtomicFile::Create(RawDescriptionPath(path_), job_);
    if (!file.ok()) return file.status();
    description_.emplace(*std::move(file));
    return absl::OkStatus();
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (parts_.Take(array, bytes) || array >= files_.size()) return absl::OkStatus();
    const auto put = [&](std::span<const uint8_t> piece) { return files_[array].Write(piece, job_); };
    return npy_ ? elements_[array].Write(bytes, put) : put(bytes);
  }

  absl::Status Commit() override {
    if (description_) {  // before the first file has its name: the job may end here
      const std::string text = DescribeRaw(header_, paths_, sha256(), parts_.table());
      absl::Status s = description_->Write({reinterpret_cast<const uint8_t*>(text.data()), text.size()}, job_);
      if (!s.ok()) return s;
    }
    for (AtomicFile& file : files_) {
      if (absl::Status s = file.Commit(); !s.ok()) return s;
    }
    return description_ ? description_->Commit() : absl::OkStatus();
  }

 private:
  absl::StatusOr<AtomicFile> Open(const std::string& path) const {
    return path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path, job_);
  }

  std::string path_;
  bool npy_;
  const JobContext* job_;
  MemoryCharge memory_;
  ResultHeader header_;
  PartReceiver parts_;
  std::vector<std::string> paths_;
  std::vector<AtomicFile> files_;
  std::vector<NpyElements> elements_;
  std::optional<AtomicFile> description_;
};

}  // namespace

std::unique_ptr<ResultFile> MakeRawFile(const std::string& path, const JobContext* job) {
  return std::make_unique<TargetFiles>(path, false, job);
}

std::unique_ptr<ResultFile> MakeNpyFile(const std::string& path, const JobContext* job) {
  return std::make_unique<TargetFiles>(path, true, job);
}

}  // namespace voxelpipe
