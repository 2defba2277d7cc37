// VTK's image data in XML, with appended raw data.
//
// Source: "VTK XML Formats", Kitware, version 1.0 of the file format, with 64-bit headers.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/text.h"
#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/plain_elements.h"
#include "encode/formats/writers.h"
#include "job/job_work.h"
#include "job/part_receiver.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kBlockBytes = 1 << 20;  // before compression
constexpr uint64_t kBatchBlocks = 16;      // compressed at the same time

std::string_view VtkName(ElementType type) {
  switch (PlainTypeOf(type)) {
    case ElementType::kU16: return "UInt16";
    case ElementType::kU32: return "UInt32";
    case ElementType::kF32: return "Float32";
    case ElementType::kI32: return "Int32";
    case ElementType::kU64: return "Int64";  // counts below 2^63, as .npz has them
    default: return "UInt8";
  }
}

class VtiFile final : public ResultFile {
 public:
  VtiFile(std::string path, const JobContext* job) : path_(std::move(path)), job_(job), memory_(&MemoryOf(job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(".vti", header.kind, header.specs.size()); !s.ok()) return s;
    header_ = header;
    const uint64_t voxels = header.grid.voxels();
    for (size_t i = 0; i < header.specs.size(); ++i) {
      const ElementType type = header.arrays[i].type;
      const auto components = uint64_t(header.specs[i].components);
      elements_.emplace_back(type, voxels * components);
      // The components of VTK's arrays lie together, so a plane of a planar target is an array of its own.
      const uint64_t planes = header.layout == Layout::kPlanar ? components : 1;
      for (uint64_t plane = 0; plane < planes; ++plane) {
        std::string name = header.arrays[i].name;
        if (planes > 1) absl::StrAppend(&name, "_", plane);
        const uint64_t bytes = ArrayBytes(PlainTypeOf(type), voxels * components / planes);
        outputs_.push_back({std::move(name), VtkName(type), components / planes, bytes});
      }
    }
    cells_ = outputs_.size();
    AddFields();
    absl::StatusOr<AtomicFile> file = path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path_, job_);
    if (!file.ok()) return file.status();
    file_.emplace(*std::move(file));
    // The table of a compressed array stands before its blocks, whose sizes are known only after them.
    compresses_ = file_->can_write_at();
    const uint64_t parts = 2 * PartReceiver::MemoryBytes(header) + NamesBytes();
    if (absl::Status s = memory_.Grow(BufferBytes() + parts, "compression:"); !s.ok()) return s;
    parts_.Begin(header);
    if (!compresses_) {
      uint64_t offset = 0;
      for (Output& output : outputs_) {
        output.offset = offset;
        offset += sizeof(uint64_t) + output.bytes;
      }
    }
    const std::string head = Head();
    data_begin_ = head.size();
    if (absl::Status s = Append(BytesOf(head)); !s.ok()) return s;
    return BeginOutput();
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (parts_.Take(array, bytes) || array >= elements_.size()) return absl::OkStatus();
    return elements_[array].Write(bytes, [this](std::span<const uint8_t> plain) {
      while (!plain.empty()) {
        const std::span<const uint8_t> piece =
            plain.first(size_t(std::min<uint64_t>(plain.size(), outputs_[open_].bytes - received_)));
        if (absl::Status s = Take(piece); !s.ok()) return s;
        plain = plain.subspan(piece.size());
        received_ += piece.size();
        if (received_ < outputs_[open_].bytes) continue;
        if (absl::Status s = EndOutput(); !s.ok()) return s;
        ++open_;
        if (open_ == cells_) break;
        if (absl::Status s = BeginOutput(); !s.ok()) return s;
      }
      return absl::OkStatus();
    });
  }

  absl::Status Commit() override {
    if (open_ < cells_) return absl::InternalError(absl::StrCat("'", path_, "': the result is not complete"));
    if (absl::Status s = WriteFields(); !s.ok()) return s;
    if (absl::Status s = Append(BytesOf("\n  </AppendedData>\n</VTKFile>\n")); !s.ok()) return s;
    if (compresses_) {
      if (absl::Status s = file_->WriteAt(0, BytesOf(Head())); !s.ok()) return s;
    }
    return file_->Commit();
  }

 private:
  // An array of field data for each column of the table of parts. All sizes are known but that of the names, which come
  // last.
  void AddFields() {
    const PartShape shape = header_.parts();
    for (size_t i = header_.first_part_array(); i + 2 < header_.arrays.size(); ++i) {
      const ArraySpec& array = header_.arrays[i];
      outputs_.push_back({array.name, VtkName(array.type), shape.parts, array.bytes()});
    }
    if (shape.parts > 0) outputs_.push_back({"part_name", "String", shape.parts, NamesBytes()});
  }

  // The most that the names take in the file, where each ends with a zero.
  uint64_t NamesBytes() const { return header_.parts().name_bytes + header_.parts().parts; }

  absl::Status WriteFields() {
    PartTable table = parts_.table();
    const std::vector<std::span<uint8_t>> arrays = ArraysOf(table);
    for (; open_ < outputs_.size(); ++open_) {
      const bool last = open_ + 1 == outputs_.size();
      std::string names;
      if (last) names.reserve(NamesBytes());
      for (size_t i = 0; last && i < table.size(); ++i) names.append(CleanText(table.Name(i))).push_back('\0');
      const std::span<const uint8_t> bytes = last ? BytesOf(names) : arrays[open_ - cells_];
      outputs_[open_].bytes = bytes.size();
      absl::Status s = BeginOutput();
      if (s.ok()) s = Take(bytes);
      if (s.ok()) s = EndOutput();
      if (!s.ok()) return s;
    }
    return absl::OkStatus();
  }

  uint64_t BufferBytes() const {
    uint64_t most = 0, bytes = 0;
    for (const Output& output : outputs_) most = std::max(most, output.bytes);
    for (size_t i = 0; i < elements_.size(); ++i) {
      const uint64_t count = header_.grid.voxels() * uint64_t(header_.specs[i].components);
      bytes += PlainElements::MemoryBytes(header_.arrays[i].type, count);
    }
    if (!compresses_) return bytes;
    const uint64_t batch = std::min(most, kBatchBlocks * kBlockBytes);
    // The batch, its compressed blocks, and the table, once as zeros.
    return bytes + batch + (batch / kBlockBytes + 1) * ZlibBlockBytes(std::min(batch, kBlockBytes)) +
           2 * (3 + most / kBlockBytes + 1) * sizeof(uint64_t);
  }

  struct Output {
    std::string name;
    std::string_view type;
    uint64_t components;  // of a field: its elements
    uint64_t bytes;       // without compression
    uint64_t offset = 0;  // of its table or size, from the first byte of the data
  };

  // The document before the data. Its length does not depend on the offsets.
  std::string Head() const {
    const GridSpec& grid = header_.grid;
    const std::string extent = absl::StrCat("0 ", grid.dims[0], " 0 ", grid.dims[1], " 0 ", grid.dims[2]);
    std::string head = absl::StrCat(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" "
        "header_type=\"UInt64\"",
        compresses_ ? " compressor=\"vtkZLibDataCompressor\"" : "", ">\n  <ImageData WholeExtent=\"", extent,
        "\" Origin=\"", Vector(grid.origin), "\" Spacing=\"", Vector(grid.voxel_size), "\">\n");
    const auto add = [&head](const Output& output, std::string_view element, std::string_view size) {
      absl::StrAppend(&head, "        <", std::string(element), " type=\"", std::string(output.type), "\" Name=\"",
                      output.name, "\" ", std::string(size), "=\"", output.components,
                      "\" format=\"appended\" offset=\"", absl::StrFormat("%020d", output.offset), "\"/>\n");
    };
    if (cells_ < outputs_.size()) {
      absl::StrAppend(&head, "    <FieldData>\n");
      for (size_t i = cells_; i < outputs_.size(); ++i) {
        add(outputs_[i], outputs_[i].type == "String" ? "Array" : "DataArray", "NumberOfTuples");
      }
      absl::StrAppend(&head, "    </FieldData>\n");
    }
    absl::StrAppend(&head, "    <Piece Extent=\"", extent, "\">\n      <PointData/>\n      <CellData Scalars=\"",
                    outputs_[0].name, "\">\n");
    for (size_t i = 0; i < cells_; ++i) add(outputs_[i], "DataArray", "NumberOfComponents");
    absl::StrAppend(&head, "      </CellData>\n    </Piece>\n  </ImageData>\n  <AppendedData encoding=\"raw\">\n   _");
    return head;
  }

  static std::string Vector(const Vec3d& v) {
    return absl::StrCat(Shortest(v.x), " ", Shortest(v.y), " ", Shortest(v.z));
  }

  absl::Status Append(std::span<const uint8_t> bytes) {
    at_ += bytes.size();
    return file_->Write(bytes, job_);
  }

  absl::Status BeginOutput() {
    Output& output = outputs_[open_];
    received_ = 0;
    if (!compresses_) return Append(Bytes().Put(output.bytes).span());
    output.offset = at_ - data_begin_;
    const uint64_t blocks = (output.bytes + kBlockBytes - 1) / kBlockBytes;
    table_.reserve(3 + blocks);
    table_.assign(3, 0);
    batch_.reserve(size_t(std::min(output.bytes, kBatchBlocks * kBlockBytes)));
    return Append(std::vector<uint8_t>((3 + blocks) * sizeof(uint64_t)));
  }

  absl::Status Take(std::span<const uint8_t> bytes) {
    if (!compresses_) return Append(bytes);
    while (!bytes.empty()) {
      const std::span<const uint8_t> piece =
          bytes.first(std::min<size_t>(bytes.size(), kBatchBlocks * kBlockBytes - batch_.size()));
      batch_.insert(batch_.end(), piece.begin(), piece.end());
      bytes = bytes.subspan(piece.size());
      if (batch_.size() < kBatchBlocks * kBlockBytes) break;
      if (absl::Status s = WriteBatch(); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  absl::Status WriteBatch() {
    const size_t blocks = (batch_.size() + kBlockBytes - 1) / kBlockBytes;
    std::vector<std::vector<uint8_t>> compressed(blocks);
    std::atomic<bool> stopped{false};
    tbb::parallel_for(size_t{0}, blocks, [&](size_t i) {
      const std::span<const uint8_t> rest = std::span<const uint8_t>(batch_).subspan(i * kBlockBytes);
      absl::StatusOr<std::vector<uint8_t>> block =
          ZlibBlock(rest.first(std::min<size_t>(rest.size(), kBlockBytes)), job_);
      if (!block.ok()) {
        stopped = true;
        return;
      }
      compressed[i] = *std::move(block);
    });
    if (stopped) return job_->Check();
    batch_.clear();
    for (const std::vector<uint8_t>& block : compressed) {
      table_.push_back(block.size());
      if (absl::Status s = Append(block); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  absl::Status EndOutput() {
    if (!compresses_) return absl::OkStatus();
    if (absl::Status s = WriteBatch(); !s.ok()) return s;
    table_[0] = table_.size() - 3;
    table_[1] = kBlockBytes;
    table_[2] = outputs_[open_].bytes % kBlockBytes;  // 0: the last block is a whole one
    return file_->WriteAt(data_begin_ + outputs_[open_].offset,
                          {reinterpret_cast<const uint8_t*>(table_.data()), table_.size() * sizeof(uint64_t)});
  }

  std::string path_;
  const JobContext* job_;
  MemoryCharge memory_;
  ResultHeader header_;
  PartReceiver parts_;
  std::optional<AtomicFile> file_;
  bool compresses_ = false;
  std::vector<PlainElements> elements_;  // one a target
  std::vector<Output> outputs_;          // in stream order
  size_t cells_ = 0;                     // how many of them are of the targets; the others are fields
  size_t open_ = 0;                      // the one that receives
  uint64_t received_ = 0;                // its bytes so far
  uint64_t at_ = 0, data_begin_ = 0;     // in the file
  std::vector<uint8_t> batch_;
  std::vector<uint64_t> table_;
};

}  // namespace

std::unique_ptr<ResultFile> MakeVtiFile(const std::string& path, const JobContext* job) {
  return std::make_unique<VtiFile>(path, job);
}

}  // namespace voxelpipe
