// NRRD, the nearly raw raster data of Teem, with gzip.
//
// Source: G. Kindlmann, "Definition of NRRD File Format", version 4 (teem.sourceforge.net/nrrd/format.html).
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/plain_elements.h"
#include "encode/formats/writers.h"
#include "job/job_work.h"

namespace voxelpipe {
namespace {

std::string_view NrrdName(ElementType type) {
  switch (PlainTypeOf(type)) {
    case ElementType::kU16: return "uint16";
    case ElementType::kU32: return "uint32";
    case ElementType::kF32: return "float";
    default: return "uint8";
  }
}

// The axes are those of .nii.gz: programs that turn them, as ITK does, place both files alike.
// Sizes are those of the file, the fastest first. The components of a vector are an axis of its own without a place:
// the fastest if interleaved, the slowest if planar.
std::string NrrdHead(const ResultHeader& header) {
  const GridSpec& grid = header.grid;
  const int components = header.specs[0].components;
  const bool first = components > 1 && header.layout == Layout::kInterleaved;
  const bool last = components > 1 && !first;
  const auto axes = [&](const std::string& of_components, const std::string& of_space) {
    return absl::StrCat(first ? of_components + " " : "", of_space, last ? " " + of_components : "", "\n");
  };
  const auto vector = [](double x, double y, double z) {
    return absl::StrCat("(", Shortest(x), ",", Shortest(y), ",", Shortest(z), ")");
  };
  const Vec3d &h = grid.voxel_size, &o = grid.origin;
  return absl::StrCat("NRRD0004\n# voxelpipe\ntype: ", std::string(NrrdName(header.arrays[0].type)),
                      "\ndimension: ", components > 1 ? 4 : 3, "\nspace: right-anterior-superior\nsizes: ",
                      axes(absl::StrCat(components), absl::StrCat(grid.dims[0], " ", grid.dims[1], " ", grid.dims[2])),
                      "space directions: ",
                      axes("none", absl::StrCat(vector(h.x, 0, 0), " ", vector(0, h.y, 0), " ", vector(0, 0, h.z))),
                      "centerings: ", axes("none", "cell cell cell"), "kinds: ", axes("vector", "domain domain domain"),
                      "endian: little\nencoding: gzip\nspace origin: ",  // the centre of the first voxel
                      vector(o.x + h.x / 2, o.y + h.y / 2, o.z + h.z / 2), "\n\n");
}

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
    if (absl::Status s = file_->Write(BytesOf(NrrdHead(header)), job_); !s.ok()) return s;
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
