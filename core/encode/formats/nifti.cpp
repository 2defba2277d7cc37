// NIfTI-1, and NIfTI-2 for grids whose sizes or place the first does not hold.
//
// Sources: R. Cox et al., nifti1.h, 2003; M. Jenkinson et al., nifti2.h, 2011 (nifti.nimh.nih.gov).
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/nifti_header.h"
#include "encode/formats/plain_elements.h"
#include "encode/formats/writers.h"
#include "job/job_work.h"

namespace voxelpipe {
namespace {

constexpr int kUnknownUnit = 0;      // that of the mesh, which the result does not know
constexpr int kAligned = 2;          // to the coordinates of something else: here the mesh
constexpr int kVectorIntent = 1007;  // the fifth axis has the components

struct NiftiType {
  int16_t code, bits;
};

NiftiType TypeOf(ElementType type) {
  switch (PlainTypeOf(type)) {
    case ElementType::kU16: return {512, 16};
    case ElementType::kU32: return {768, 32};
    case ElementType::kF32: return {16, 32};
    default: return {2, 8};
  }
}

// The fields that both headers have, in numbers of their own sizes.
struct Fields {
  std::array<int64_t, 8> dim;
  std::array<double, 8> step;
  std::array<std::array<double, 4>, 3> to_world;  // of indices; integers are centres
  NiftiType type;
  int intent;
};

Fields FieldsOf(const ResultHeader& header) {
  const GridSpec& grid = header.grid;
  const int components = header.specs[0].components;
  Fields fields{};
  fields.dim = {components > 1 ? 5 : 3, grid.dims[0], grid.dims[1], grid.dims[2], 1, components, 1, 1};
  fields.step = {1, grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z, 1, 1, 1, 1};
  const Mat4d to_world = grid.index_to_world();
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 4; ++c) fields.to_world[r][c] = to_world.m[r][c];
  }
  fields.type = TypeOf(header.arrays[0].type);
  fields.intent = components > 1 ? kVectorIntent : 0;
  return fields;
}

// True if NIfTI-1 holds the fields: dims of 16 bits, and places whose float32 are within a thousandth of a voxel.
bool FitNifti1(const Fields& fields) {
  for (const int64_t dim : fields.dim) {
    if (dim > INT16_MAX) return false;
  }
  for (size_t r = 0; r < 3; ++r) {
    const double place = fields.to_world[r][3];
    if (!(std::abs(double(float(place)) - place) <= 1e-3 * fields.step[r + 1])) return false;
  }
  return true;
}

std::string Nifti1(const Fields& fields) {
  Bytes h;
  h.Put(int32_t{348}).Padded("", 10 + 18 + 4 + 2 + 1).Put(int8_t{0});
  for (const int64_t dim : fields.dim) h.Put(int16_t(dim));
  h.Put(0.0f).Put(0.0f).Put(0.0f).Put(int16_t(fields.intent));
  h.Put(fields.type.code).Put(fields.type.bits).Put(int16_t{0});
  for (const double step : fields.step) h.Put(float(step));
  h.Put(352.0f).Put(1.0f).Put(0.0f);  // where voxels begin; no other scale
  h.Put(int16_t{0}).Put(int8_t{0}).Put(int8_t{kUnknownUnit});
  h.Put(0.0f).Put(0.0f).Put(0.0f).Put(0.0f).Put(int32_t{0}).Put(int32_t{0});
  h.Padded("voxelpipe", 80).Padded("", 24);
  h.Put(int16_t{kAligned}).Put(int16_t{kAligned});
  h.Put(0.0f).Put(0.0f).Put(0.0f);  // no rotation
  for (const auto& row : fields.to_world) h.Put(float(row[3]));
  for (const auto& row : fields.to_world) {
    for (const double number : row) h.Put(float(number));
  }
  h.Padded("", 16).Padded("n+1", 4);
  h.Put(int32_t{0});  // no extensions
  return h.text();
}

std::string Nifti2(const Fields& fields) {
  Bytes h;
  h.Put(int32_t{540}).Text(std::string_view("n+2\0\r\n\x1a\n", 8)).Put(fields.type.code).Put(fields.type.bits);
  for (const int64_t dim : fields.dim) h.Put(dim);
  h.Put(0.0).Put(0.0).Put(0.0);
  for (const double step : fields.step) h.Put(step);
  h.Put(int64_t{544}).Put(1.0).Put(0.0);
  h.Put(0.0).Put(0.0).Put(0.0).Put(0.0).Put(int64_t{0}).Put(int64_t{0});
  h.Padded("voxelpipe", 80).Padded("", 24);
  h.Put(int32_t{kAligned}).Put(int32_t{kAligned});
  h.Put(0.0).Put(0.0).Put(0.0);
  for (const auto& row : fields.to_world) h.Put(row[3]);
  for (const auto& row : fields.to_world) {
    for (const double number : row) h.Put(number);
  }
  h.Put(int32_t{0}).Put(int32_t{kUnknownUnit}).Put(int32_t(fields.intent));
  h.Padded("", 16).Put(int8_t{0}).Padded("", 15);
  h.Put(int32_t{0});
  return h.text();
}

class NiftiFile final : public ResultFile {
 public:
  NiftiFile(std::string path, const JobContext* job) : path_(std::move(path)), job_(job), memory_(&MemoryOf(job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(".nii.gz", header.kind, header.specs.size()); !s.ok()) return s;
    const auto components = size_t(header.specs[0].components);
    const uint64_t count = header.grid.voxels() * components;
    // The components are the slowest axis of the file. Interleaved ones are compressed side by side, each into a part
    // of its own; the parts follow each other in the file.
    const size_t parts = header.layout == Layout::kInterleaved ? components : 1;
    const ElementType type = header.arrays[0].type;
    element_bytes_ = ArrayBytes(PlainTypeOf(type), 1);
    uint64_t buffers = PlainElements::MemoryBytes(type, count) + parts * kDeflateBytes;
    if (parts > 1) buffers += std::min<uint64_t>(kPieceBytes, count * element_bytes_) + parts * element_bytes_;
    if (absl::Status s = memory_.Grow(buffers, "compression:"); !s.ok()) return s;
    absl::StatusOr<AtomicFile> file = path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path_, job_);
    if (!file.ok()) return file.status();
    file_.emplace(*std::move(file));
    elements_.emplace(type, count);
    gzip_.reserve(parts);
    for (size_t i = 0; i < parts; ++i) gzip_.emplace_back(job_);
    for (size_t i = 1; i < parts; ++i) later_.emplace_back(MemoryOf(job_));
    planes_.resize(parts);
    const uint64_t piece = parts == 1 ? 0 : std::min<uint64_t>(kPieceBytes, count * element_bytes_);
    for (std::vector<uint8_t>& plane : planes_) plane.reserve(piece / parts + element_bytes_);
    if (absl::Status s = file_->Write(BytesOf(GzipHeader()), job_); !s.ok()) return s;
    return gzip_[0].Write(BytesOf(NiftiHeader(header)), PutPart(0));
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (array > 0) return absl::OkStatus();  // the table of parts
    return elements_->Write(bytes, [this](std::span<const uint8_t> plain) {
      if (gzip_.size() == 1) return gzip_[0].Write(plain, PutPart(0));
      return Separate(plain);
    });
  }

  absl::Status Commit() override {
    for (size_t i = 0; i < gzip_.size(); ++i) {
      if (absl::Status s = gzip_[i].Finish(PutPart(i)); !s.ok()) return s;
      if (i == 0) continue;
      if (absl::Status s = file_->Write(later_[i - 1].bytes, job_); !s.ok()) return s;
      later_[i - 1].bytes = {};
      later_[i - 1].growth.TakeCharge();
    }
    if (absl::Status s = file_->Write(BytesOf(GzipEnd(gzip_)), job_); !s.ok()) return s;
    return file_->Commit();
  }

 private:
  DeflatePart::Output PutPart(size_t part) {
    return [this, part](std::span<const uint8_t> compressed) -> absl::Status {
      if (part == 0) return file_->Write(compressed, job_);
      Later& later = later_[part - 1];
      absl::Status s = later.growth.Reach(later.bytes.size() + compressed.size(), later.bytes);
      if (s.ok()) later.bytes.insert(later.bytes.end(), compressed.begin(), compressed.end());
      return s;
    };
  }

  // Distributes interleaved components, a piece at a time. A piece may end within a component or a voxel.
  absl::Status Separate(std::span<const uint8_t> bytes) {
    const uint64_t voxel_bytes = element_bytes_ * planes_.size();
    while (!bytes.empty()) {
      const std::span<const uint8_t> piece = bytes.first(std::min(bytes.size(), kPieceBytes));
      bytes = bytes.subspan(piece.size());
      if (absl::Status s = CheckJob(job_); !s.ok()) return s;
      size_t i = 0;
      while (i < piece.size()) {
        const uint64_t end = at_ % element_bytes_ == 0 && piece.size() - i >= element_bytes_ ? element_bytes_ : 1;
        std::vector<uint8_t>& plane = planes_[at_ / element_bytes_];
        plane.insert(plane.end(), piece.begin() + ptrdiff_t(i), piece.begin() + ptrdiff_t(i + end));
        i += end;
        at_ = at_ + end == voxel_bytes ? 0 : at_ + end;
      }
      for (size_t part = 0; part < planes_.size(); ++part) {
        if (absl::Status s = gzip_[part].Write(planes_[part], PutPart(part)); !s.ok()) return s;
        planes_[part].clear();
      }
    }
    return absl::OkStatus();
  }

  static constexpr size_t kPieceBytes = 1 << 20;

  // A compressed part that waits for those before it.
  struct Later {
    explicit Later(MemoryBudget& budget) : growth(budget, 1, "compressed components:") {}
    ChargedGrowth growth;
    std::vector<uint8_t> bytes;
  };

  std::string path_;
  const JobContext* job_;
  MemoryCharge memory_;
  std::optional<AtomicFile> file_;
  std::optional<PlainElements> elements_;
  std::vector<DeflatePart> gzip_;
  std::vector<Later> later_;                  // the parts after the first
  std::vector<std::vector<uint8_t>> planes_;  // of a piece
  uint64_t element_bytes_ = 1, at_ = 0;       // at_: in a voxel
};

}  // namespace

std::string NiftiHeader(const ResultHeader& header) {
  const Fields fields = FieldsOf(header);
  return FitNifti1(fields) ? Nifti1(fields) : Nifti2(fields);
}

std::unique_ptr<ResultFile> MakeNiftiFile(const std::string& path, const JobContext* job) {
  return std::make_unique<NiftiFile>(path, job);
}

}  // namespace voxelpipe
