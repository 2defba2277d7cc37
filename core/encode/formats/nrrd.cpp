// NRRD, the nearly raw raster data of Teem, with gzip.
//
// Source: G. Kindlmann, "Definition of NRRD File Format", version 4 (teem.sourceforge.net/nrrd/format.html).
#include <optional>
#include <vector>

#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/nrrd_header.h"
#include "encode/formats/plain_elements.h"
#include "encode/formats/writers.h"
#include "job/job_work.h"

namespace voxelpipe {
namespace {

class NrrdFile final : public ResultFile {
 public:
  NrrdFile(std::string path, const JobContext* job) : path_(std::move(path)), job_(job), memory_(&MemoryOf(job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(".nrrd", header.kind, header.specs.size()); !s.ok()) return s;
    const ElementType type = header.arrays[0].type;
    const uint64_t count = header.grid.voxels() * uint64_t(header.specs[0].components);
    const uint64_t buffers = PlainElements::MemoryBytes(type, count) + kDeflateBytes;
    if (absl::Status s = memory_.Grow(buffers, "compression:"); !s.ok()) return s;
    absl::StatusOr<AtomicFile> file = path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path_, job_);
    if (!file.ok()) return file.status();
    file_.emplace(*std::move(file));
    elements_.emplace(type, count);
    gzip_.emplace_back(job_);
    if (absl::Status s = file_->Write(BytesOf(NrrdFields(header) + "\n"), job_); !s.ok()) return s;
    return file_->Write(BytesOf(GzipHeader()), job_);
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (array > 0) return absl::OkStatus();  // the table of parts
    return elements_->Write(bytes, [this](std::span<const uint8_t> plain) { return gzip_[0].Write(plain, Put()); });
  }

  absl::Status Commit() override {
    if (absl::Status s = gzip_[0].Finish(Put()); !s.ok()) return s;
    if (absl::Status s = file_->Write(BytesOf(GzipEnd(gzip_)), job_); !s.ok()) return s;
    return file_->Commit();
  }

 private:
  DeflatePart::Output Put() {
    return [this](std::span<const uint8_t> compressed) { return file_->Write(compressed, job_); };
  }

  std::string path_;
  const JobContext* job_;
  MemoryCharge memory_;
  std::optional<AtomicFile> file_;
  std::optional<PlainElements> elements_;
  std::vector<DeflatePart> gzip_;  // one
};

}  // namespace

std::unique_ptr<ResultFile> MakeNrrdFile(const std::string& path, const JobContext* job) {
  return std::make_unique<NrrdFile>(path, job);
}

}  // namespace voxelpipe
