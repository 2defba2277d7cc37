// 3D Slicer's segmentation: a labelmap in NRRD, with names and colours of its labels in the header.
//
// Source: "Segmentation labelmap file format (.seg.nrrd)", 3D Slicer's developer guide, 5.4 (slicer.readthedocs.io).
#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <optional>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/text.h"
#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/nrrd_header.h"
#include "encode/formats/plain_elements.h"
#include "encode/formats/writers.h"
#include "encode/preview/legend.h"
#include "job/job_work.h"
#include "job/part_receiver.h"

namespace voxelpipe {
namespace {

constexpr uint32_t kMaxLabel = std::numeric_limits<int32_t>::max();  // as Slicer has them
constexpr size_t kMaxSegments = 65'535;

// The smallest box of voxels with a label: first and last index an axis.
struct Extent {
  std::array<int32_t, 3> first{0, 0, 0}, last{-1, -1, -1};  // of no voxel as Slicer writes it

  void Include(int32_t x0, int32_t x1, int32_t y, int32_t z) {
    if (last[0] < 0) {
      first = {x0, y, z};
      last = {x1, y, z};
      return;
    }
    const std::array<int32_t, 3> from = {x0, y, z}, to = {x1, y, z};
    for (size_t a = 0; a < 3; ++a) {
      first[a] = std::min(first[a], from[a]);
      last[a] = std::max(last[a], to[a]);
    }
  }
};

// Finds the labels of voxels and their boxes. Takes the voxels in linear order, in any pieces.
class LabelBoxes {
 public:
  LabelBoxes(const ResultHeader& header, const JobContext* job)
      : dims_(header.grid.dims),
        bytes_each_(ArrayBytes(PlainTypeOf(header.arrays[0].type), 1)),
        growth_(MemoryOf(job), TableEntryBytes(sizeof(std::pair<const uint32_t, Extent>)), "labels:"),
        poll_(job) {}

  // Errors: INVALID_ARGUMENT for a label or a number of labels that the format does not hold; the job's.
  absl::Status Write(std::span<const uint8_t> bytes) {
    while (!bytes.empty() && !split_.empty()) {
      split_.push_back(bytes.front());
      bytes = bytes.subspan(1);
      if (split_.size() < bytes_each_) continue;
      if (absl::Status s = Take(split_.data(), 1); !s.ok()) return s;
      split_.clear();
    }
    const size_t whole = bytes.size() / bytes_each_;
    if (absl::Status s = Take(bytes.data(), whole); !s.ok()) return s;
    bytes = bytes.subspan(whole * bytes_each_);
    split_.insert(split_.end(), bytes.begin(), bytes.end());
    return absl::OkStatus();
  }

  const absl::flat_hash_map<uint32_t, Extent>& boxes() const { return boxes_; }

 private:
  absl::Status Take(const uint8_t* data, size_t count) {
    switch (bytes_each_) {
      case 1: return TakeAs<uint8_t>(data, count);
      case 2: return TakeAs<uint16_t>(data, count);
      default: return TakeAs<uint32_t>(data, count);
    }
  }

  // Row after row, each in runs of one label.
  template <typename T>
  absl::Status TakeAs(const uint8_t* data, size_t count) {
    const auto at = [&](size_t n) {
      T value;
      std::memcpy(&value, data + n * sizeof(T), sizeof(T));
      return value;
    };
    for (size_t n = 0; n < count;) {
      const size_t row_end = n + std::min(count - n, size_t(dims_[0] - x_));
      while (n < row_end) {
        const T label = at(n);
        size_t end = n + 1;
        while (end < row_end && at(end) == label) ++end;
        const auto length = int64_t(end - n);
        if (label != 0) {
          if (absl::Status s = Include(label, x_, x_ + length - 1); !s.ok()) return s;
        }
        x_ += length;
        n = end;
        if (absl::Status s = poll_.Add(1 + uint64_t(length) / 64); !s.ok()) return s;
      }
      if (x_ < dims_[0]) continue;
      x_ = 0;
      if (++y_ < dims_[1]) continue;
      y_ = 0;
      ++z_;
    }
    return absl::OkStatus();
  }

  absl::Status Include(uint32_t label, int64_t x0, int64_t x1) {
    if (label != last_label_ || last_ == nullptr) {
      if (label > kMaxLabel) {
        return absl::InvalidArgumentError(absl::StrCat(".seg.nrrd holds labels up to ", kMaxLabel, "; a voxel has ",
                                                       label, "; .nrrd and .npz hold it"));
      }
      if (absl::Status s = growth_.Reach(boxes_.size() + 1, boxes_); !s.ok()) return s;
      last_ = &boxes_[label];
      last_label_ = label;
      if (boxes_.size() > kMaxSegments) {
        return absl::InvalidArgumentError(
            absl::StrCat(".seg.nrrd holds up to ", kMaxSegments, " labels; these voxels have more"));
      }
    }
    last_->Include(int32_t(x0), int32_t(x1), int32_t(y_), int32_t(z_));
    return absl::OkStatus();
  }

  std::array<int64_t, 3> dims_;
  size_t bytes_each_;
  ChargedGrowth growth_;
  JobPoll poll_;
  std::vector<uint8_t> split_;  // the first bytes of a voxel whose others have not arrived
  int64_t x_ = 0, y_ = 0, z_ = 0;
  absl::flat_hash_map<uint32_t, Extent> boxes_;
  uint32_t last_label_ = 0;
  Extent* last_ = nullptr;  // that of last_label_, until the next label is found
};

// A text as a value of a key, which ends with its line. CleanText left no line breaks in it.
std::string Escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\\') escaped += '\\';
    escaped += c;
  }
  return escaped;
}

std::string SegmentFields(size_t number, const LegendEntry& entry, const Extent& box) {
  const std::string key = absl::StrCat("Segment", number, "_");
  const auto channel = [&](int shift) { return absl::StrFormat("%.6f", double(entry.rgb >> shift & 255) / 255); };
  const std::string name = entry.name.empty() ? absl::StrCat("label ", entry.label) : Escaped(entry.name);
  std::string extent;
  for (size_t a = 0; a < 3; ++a) absl::StrAppend(&extent, a > 0 ? " " : "", box.first[a], " ", box.last[a]);
  return absl::StrCat(key, "Color:=", channel(16), " ", channel(8), " ", channel(0), "\n", key,
                      "ColorAutoGenerated:=1\n", key, "Extent:=", extent, "\n", key, "ID:=Segment_", entry.label, "\n",
                      key, "LabelValue:=", entry.label, "\n", key, "Layer:=0\n", key, "Name:=", name, "\n", key,
                      "NameAutoGenerated:=", entry.name.empty() ? 1 : 0, "\n", key, "Tags:=|\n");
}

// What Slicer writes of a segmentation as a whole. The two names of the stored representation are those of Slicer from
// 5.2 on and before.
constexpr std::string_view kSegmentationFields =
    "Segmentation_ContainedRepresentationNames:=Binary labelmap|\n"
    "Segmentation_MasterRepresentation:=Binary labelmap\n"
    "Segmentation_ReferenceImageExtentOffset:=0 0 0\n"
    "Segmentation_SourceRepresentation:=Binary labelmap\n";

// The header begins the file and names what is known last, so the voxels wait in memory, compressed.
class SegNrrdFile final : public ResultFile {
 public:
  SegNrrdFile(std::string path, const JobContext* job)
      : path_(std::move(path)), job_(job), memory_(&MemoryOf(job)), growth_(MemoryOf(job), 1, "compressed voxels:") {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(".seg.nrrd", header.kind, header.specs); !s.ok()) return s;
    header_ = header;
    const ElementType type = header.arrays[0].type;
    const uint64_t voxels = header.grid.voxels();
    const uint64_t parts = PartReceiver::MemoryBytes(header) + LegendBytes(header.parts());
    const uint64_t buffers = PlainElements::MemoryBytes(type, voxels) + kDeflateBytes;
    if (absl::Status s = memory_.Grow(buffers + parts, "compression:"); !s.ok()) return s;
    absl::StatusOr<AtomicFile> file = path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path_, job_);
    if (!file.ok()) return file.status();
    file_.emplace(*std::move(file));
    parts_.Begin(header);
    elements_.emplace(type, voxels);
    boxes_.emplace(header, job_);
    gzip_.emplace_back(job_);
    return absl::OkStatus();
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (parts_.Take(array, bytes) || array > 0) return absl::OkStatus();
    return elements_->Write(bytes, [this](std::span<const uint8_t> plain) {
      absl::Status s = boxes_->Write(plain);
      return s.ok() ? gzip_[0].Write(plain, Keep()) : s;
    });
  }

  absl::Status Commit() override {
    if (absl::Status s = gzip_[0].Finish(Keep()); !s.ok()) return s;
    constexpr uint64_t kFieldsBytes = 512;  // of a segment, twice what they are, without the name
    const uint64_t most = boxes_->boxes().size() + parts_.table().size();
    const uint64_t names = 4 * uint64_t(parts_.table().name.size());
    absl::Status s = memory_.Grow(most * (kFieldsBytes + 2 * sizeof(LegendEntry)) + names, "a header:");
    if (!s.ok()) return s;
    const std::vector<LegendEntry> segments = Segments();
    std::string head = NrrdFields(header_);
    for (size_t n = 0; n < segments.size(); ++n) {
      const auto box = boxes_->boxes().find(segments[n].label);
      absl::StrAppend(&head, SegmentFields(n, segments[n], box == boxes_->boxes().end() ? Extent{} : box->second));
    }
    absl::StrAppend(&head, std::string(kSegmentationFields), "\n", GzipHeader());
    s = file_->Write(BytesOf(head), job_);
    if (s.ok()) s = file_->Write(compressed_, job_);
    if (s.ok()) s = file_->Write(BytesOf(GzipEnd(gzip_)), job_);
    return s.ok() ? file_->Commit() : s;
  }

 private:
  DeflatePart::Output Keep() {
    return [this](std::span<const uint8_t> piece) {
      absl::Status s = growth_.Reach(compressed_.size() + piece.size(), compressed_);
      if (s.ok()) compressed_.insert(compressed_.end(), piece.begin(), piece.end());
      return s;
    };
  }

  // Those of the parts, where the voxels hold their labels, and every other label of a voxel. Ascending.
  std::vector<LegendEntry> Segments() const {
    std::vector<LegendEntry> segments;
    if (HoldsLabels(header_.specs[0], header_.kind)) segments = LegendOf(parts_.table());
    std::erase_if(segments, [](const LegendEntry& entry) { return entry.label > kMaxLabel; });  // of no voxel
    const size_t named = segments.size();
    for (const auto& [label, box] : boxes_->boxes()) {
      const auto end = segments.begin() + ptrdiff_t(named);
      const auto found = std::lower_bound(segments.begin(), end, label,
                                          [](const LegendEntry& entry, uint32_t l) { return entry.label < l; });
      if (found == end || found->label != label) segments.push_back({.label = label, .rgb = LabelColour(label)});
    }
    std::sort(segments.begin(), segments.end(), [](const auto& a, const auto& b) { return a.label < b.label; });
    return segments;
  }

  std::string path_;
  const JobContext* job_;
  MemoryCharge memory_;
  ResultHeader header_;
  std::optional<AtomicFile> file_;
  PartReceiver parts_;
  std::optional<PlainElements> elements_;
  std::optional<LabelBoxes> boxes_;
  std::vector<DeflatePart> gzip_;  // one
  ChargedGrowth growth_;
  std::vector<uint8_t> compressed_;
};

}  // namespace

std::unique_ptr<ResultFile> MakeSegNrrdFile(const std::string& path, const JobContext* job) {
  return std::make_unique<SegNrrdFile>(path, job);
}

}  // namespace voxelpipe
