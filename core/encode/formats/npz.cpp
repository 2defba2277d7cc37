// An .npz is a ZIP archive of .npy files (NumPy documentation, numpy.savez).

#include <algorithm>
#include <bit>
#include <cstring>
#include <optional>
#include <vector>

#include "encode/atomic_file.h"
#include "encode/formats/writers.h"
#include "encode/npy.h"
#include "encode/zip_writer.h"
#include "job/job_work.h"

namespace voxelpipe {
namespace {

constexpr size_t kPieceVoxels = 1 << 16;
constexpr uint64_t kBrick = 8;
constexpr uint64_t kMaskBytes = kBrick * kBrick * kBrick / 8;
constexpr size_t kPieceBytes = 512 << 10;
// Of indices, as many as a piece or some bricks have.
constexpr uint64_t kIjkBytes = 3 * sizeof(int32_t) * (kPieceVoxels + 8 * kMaskBytes);

template <typename T>
std::span<const uint8_t> BytesOf(const T* values, size_t count) {
  return {reinterpret_cast<const uint8_t*>(values), count * sizeof(T)};
}

class NpzFile final : public ResultFile {
 public:
  NpzFile(std::string path, const JobContext* job)
      : path_(std::move(path)), job_(job), memory_(&MemoryOf(job)), bricks_memory_(&MemoryOf(job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    header_ = header;
    uint64_t buffers = header.kind == ResultKind::kDense ? 0 : kIjkBytes, elements = 0;
    for (const ArraySpec& array : header.arrays) {
      elements = std::max(elements, NpyElements::MemoryBytes(array.type, CountOf(array)));
      if (array.name != "brick" && array.name != "mask") continue;
      if (absl::Status s = bricks_memory_.Grow(array.bytes(), "the bricks of a file:"); !s.ok()) return s;
    }
    buffers += elements;
    if (absl::Status s = memory_.Grow(buffers, "elements of a file:"); !s.ok()) return s;
    absl::StatusOr<AtomicFile> file = path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path_, job_);
    if (!file.ok()) return file.status();
    file_.emplace(*std::move(file));
    zip_.emplace(*file_, job_);
    const GridSpec& grid = header.grid;
    const double origin[3] = {grid.origin.x, grid.origin.y, grid.origin.z};
    const double voxel_size[3] = {grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z};
    const Mat4d to_world = grid.index_to_world();
    absl::Status s = Whole("dims", "<i8", {3}, BytesOf(grid.dims.data(), 3));
    if (s.ok()) s = Whole("origin", "<f8", {3}, BytesOf(origin, 3));
    if (s.ok()) s = Whole("voxel_size", "<f8", {3}, BytesOf(voxel_size, 3));
    if (s.ok()) s = Whole("index_to_world", "<f8", {4, 4}, BytesOf(&to_world.m[0][0], 16));
    return s;
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (absl::Status s = OpenUpTo(array); !s.ok()) return s;
    const std::string& name = header_.arrays[array].name;
    if (name == "brick" || name == "mask") {
      std::vector<uint8_t>& kept = name == "brick" ? bricks_ : masks_;
      kept.reserve(header_.arrays[array].bytes());
      return InPieces(bytes, [&](std::span<const uint8_t> piece) {
        kept.insert(kept.end(), piece.begin(), piece.end());
        return CheckJob(job_);
      });
    }
    if (name == "voxel") return InPieces(bytes, [&](std::span<const uint8_t> piece) { return WriteVoxels(piece); });
    return InPieces(bytes, [&](std::span<const uint8_t> piece) {
      return elements_->Write(piece, [&](std::span<const uint8_t> stored) { return zip_->Write(stored); });
    });
  }

  absl::Status Commit() override {
    if (absl::Status s = OpenUpTo(header_.arrays.size()); !s.ok()) return s;
    if (absl::Status s = zip_->Finish(); !s.ok()) return s;
    return file_->Commit();
  }

 private:
  static uint64_t CountOf(const ArraySpec& array) {
    uint64_t count = 1;
    for (const uint64_t n : array.shape) count *= n;
    return count;
  }

  // Looks at the job between pieces; the checksum of one takes some milliseconds.
  template <typename Write>
  static absl::Status InPieces(std::span<const uint8_t> bytes, const Write& write) {
    for (size_t at = 0; at < bytes.size(); at += kPieceBytes) {
      if (absl::Status s = write(bytes.subspan(at, std::min(kPieceBytes, bytes.size() - at))); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  absl::Status BeginArray(const std::string& name, std::string_view descr, const std::vector<uint64_t>& shape,
                          uint64_t bytes) {
    const std::string head = NpyHeader(descr, shape);
    if (absl::Status s = zip_->BeginEntry(name + ".npy", head.size() + bytes); !s.ok()) return s;
    return zip_->Write(BytesOf(head.data(), head.size()));
  }

  absl::Status Whole(const std::string& name, std::string_view descr, const std::vector<uint64_t>& shape,
                     std::span<const uint8_t> bytes) {
    absl::Status s = BeginArray(name, descr, shape, bytes.size());
    if (s.ok()) s = zip_->Write(bytes);
    if (s.ok()) s = zip_->EndEntry();
    return s;
  }

  // Ends the open array and begins those up to `array`; arrays in between are empty.
  absl::Status OpenUpTo(size_t array) {
    while (open_ != array) {
      absl::Status s = Close();
      if (!s.ok()) return s;
      ++open_;
      if (open_ < header_.arrays.size()) s = Open(header_.arrays[open_]);
      if (!s.ok()) return s;
    }
    return absl::OkStatus();
  }

  absl::Status Open(const ArraySpec& spec) {
    if (spec.name == "brick" || spec.name == "mask") return absl::OkStatus();
    if (spec.name == "voxel") return BeginArray("ijk", "<i4", {spec.shape[0], 3}, spec.shape[0] * 12);
    const uint64_t count = CountOf(spec);
    elements_.emplace(spec.type, count);
    // 64-bit numbers are below 2^63, so they have the bytes of int64, which NumPy adds to other integers exactly.
    const std::string_view descr = spec.type == ElementType::kU64 ? "<i8" : NpyDescr(spec.type);
    return BeginArray(spec.name == "offset" ? "offsets" : spec.name, descr, spec.shape, NpyBytes(spec.type, count));
  }

  absl::Status Close() {
    if (open_ >= header_.arrays.size()) return absl::OkStatus();
    const std::string& name = header_.arrays[open_].name;
    if (name == "brick") return absl::OkStatus();
    return name == "mask" ? WriteBricks() : zip_->EndEntry();
  }

  // ijk of a bucketed result, from linear indices that pieces may split anywhere.
  absl::Status WriteVoxels(std::span<const uint8_t> bytes) {
    const auto nx = uint64_t(header_.grid.dims[0]), ny = uint64_t(header_.grid.dims[1]);
    ijk_.clear();
    for (const uint8_t byte : bytes) {
      index_ |= uint64_t{byte} << (8 * index_bytes_);
      if (++index_bytes_ < 8) continue;
      ijk_.insert(ijk_.end(), {int32_t(index_ % nx), int32_t(index_ / nx % ny), int32_t(index_ / nx / ny)});
      index_ = 0;
      index_bytes_ = 0;
    }
    return zip_->Write(BytesOf(ijk_.data(), ijk_.size()));
  }

  // ijk of a sparse result, in the order of its values.
  absl::Status WriteBricks() {
    uint64_t voxels = 0;
    JobPoll poll(job_);
    for (const uint8_t byte : masks_) {
      voxels += uint64_t(std::popcount(byte));
      if (absl::Status s = poll.Add(1); !s.ok()) return s;
    }
    if (absl::Status s = BeginArray("ijk", "<i4", {voxels, 3}, voxels * 12); !s.ok()) return s;
    const uint64_t bx = (uint64_t(header_.grid.dims[0]) + kBrick - 1) / kBrick;
    const uint64_t by = (uint64_t(header_.grid.dims[1]) + kBrick - 1) / kBrick;
    ijk_.clear();
    ijk_.reserve(3 * (kPieceVoxels + 8 * kMaskBytes));
    for (uint64_t b = 0; b < masks_.size() / kMaskBytes; ++b) {
      uint64_t id;
      std::memcpy(&id, &bricks_[b * sizeof id], sizeof id);
      const uint64_t x = id % bx * kBrick, y = id / bx % by * kBrick, z = id / bx / by * kBrick;
      for (uint64_t i = 0; i < kMaskBytes * 8; ++i) {
        if ((masks_[b * kMaskBytes + i / 8] >> (i % 8) & 1) == 0) continue;
        ijk_.insert(ijk_.end(), {int32_t(x + i % 8), int32_t(y + i / 8 % 8), int32_t(z + i / 64)});
      }
      if (absl::Status s = poll.Add(kMaskBytes); !s.ok()) return s;
      if (ijk_.size() < 3 * kPieceVoxels) continue;
      if (absl::Status s = zip_->Write(BytesOf(ijk_.data(), ijk_.size())); !s.ok()) return s;
      ijk_.clear();
    }
    absl::Status s = zip_->Write(BytesOf(ijk_.data(), ijk_.size()));
    if (s.ok()) s = zip_->EndEntry();
    bricks_ = {};
    masks_ = {};
    bricks_memory_.ShrinkTo(0);
    return s;
  }

  std::string path_;
  const JobContext* job_;
  MemoryCharge memory_, bricks_memory_;
  ResultHeader header_;
  std::optional<AtomicFile> file_;
  std::optional<ZipWriter> zip_;
  size_t open_ = SIZE_MAX;  // the array being written
  std::optional<NpyElements> elements_;
  std::vector<uint8_t> bricks_, masks_;
  std::vector<int32_t> ijk_;
  uint64_t index_ = 0;  // a linear index of which index_bytes_ bytes have arrived
  int index_bytes_ = 0;
};

}  // namespace

std::unique_ptr<ResultFile> MakeNpzFile(const std::string& path, const JobContext* job) {
  return std::make_unique<NpzFile>(path, job);
}

}  // namespace voxelpipe
