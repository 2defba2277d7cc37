// OME-Zarr 0.4 in a directory: Zarr version 2 with coordinates.
//
// Sources: A. Miles et al., "Zarr storage specification version 2"; J. Moore et al., "OME-NGFF specification 0.4",
// 2022 (ngff.openmicroscopy.org).
#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/atomic_directory.h"
#include "encode/format_registry.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/writers.h"
#include "encode/formats/zarr_level.h"
#include "encode/npy.h"
#include "encode/part_json.h"
#include "encode/preview/legend.h"
#include "job/job_work.h"
#include "job/part_receiver.h"
#include "shaders/blend_ops.h"

namespace voxelpipe {
namespace {

using nlohmann::ordered_json;

// Levels are halved until no axis has more voxels. Viewers show the last one at once.
constexpr uint64_t kMaxLastLevel = 256;
constexpr uint64_t kJsonsOfParts = 4;  // their table, the colours and the properties of labels, and these as a text

class ZarrDirectory final : public ResultFile {
 public:
  ZarrDirectory(std::string path, const JobContext* job) : path_(std::move(path)), job_(job), memory_(&MemoryOf(job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(".zarr", header.kind, header.specs.size()); !s.ok()) return s;
    header_ = header;
    const uint64_t bytes = PartReceiver::MemoryBytes(header) + kJsonsOfParts * PartsJsonBytes(header.parts());
    if (absl::Status s = memory_.Grow(bytes, "the parts of a file:"); !s.ok()) return s;
    parts_.Begin(header);
    absl::StatusOr<AtomicDirectory> directory = AtomicDirectory::Create(path_, ".zgroup");
    if (!directory.ok()) return directory.status();
    directory_.emplace(*std::move(directory));
    const bool several = header.specs.size() > 1;
    if (several) {
      if (absl::Status s = WriteJson(".zgroup", {{"zarr_format", 2}}); !s.ok()) return s;
    }
    for (size_t i = 0; i < header.specs.size(); ++i) {
      Image image;
      image.prefix = several ? header.arrays[i].name + "/" : "";
      image.type = header.arrays[i].type;
      image.components = uint64_t(header.specs[i].components);
      const uint64_t count = header.grid.voxels() * image.components;
      if (absl::Status s = memory_.Grow(NpyElements::MemoryBytes(image.type, count), "elements of a file:"); !s.ok()) {
        return s;
      }
      image.elements.emplace(image.type, count);
      AddLevels(image);
      image.labels = IsInteger(header.specs[i].format) && HoldsLabels(header.specs[i], header.kind);
      if (absl::Status s = WriteArrays(image); !s.ok()) return s;
      images_.push_back(std::move(image));
    }
    return absl::OkStatus();
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (parts_.Take(array, bytes)) return absl::OkStatus();
    Image& image = images_[array];
    return image.elements->Write(bytes,
                                 [&](std::span<const uint8_t> stored) { return image.levels[0]->Write(stored); });
  }

  absl::Status Commit() override {
    for (const Image& image : images_) {
      if (!image.levels[0]->complete()) return absl::InternalError("the result is not complete");
    }
    // Last, as the parts come last.
    for (size_t i = 0; i < images_.size(); ++i) {
      const absl::Status s = WriteAttributes(images_[i], header_.arrays[i].name);
      if (!s.ok()) return s;
    }
    if (images_.size() > 1) {
      if (absl::Status s = WriteJson(".zattrs", {{"voxelpipe", About()}}); !s.ok()) return s;
    }
    return directory_->Commit();
  }

 private:
  // A target: a group with the arrays 0, 1, ..., each half of the one before.
  struct Image {
    std::string prefix;
    ElementType type;
    uint64_t components;
    bool labels = false;
    std::optional<NpyElements> elements;
    std::unique_ptr<ZarrLevel> first;
    std::vector<ZarrLevel*> levels;  // the first one and those below it
  };

  void AddLevels(Image& image) const {
    const auto& dims = header_.grid.dims;
    const uint64_t planes = header_.layout == Layout::kPlanar ? image.components : 1;
    image.first = std::make_unique<ZarrLevel>(image.prefix + "0/", image.type,
                                              ZarrLevel::Dims{uint64_t(dims[2]), uint64_t(dims[1]), uint64_t(dims[0])},
                                              planes, image.components / planes, *directory_, job_);
    image.levels = {image.first.get()};
    while (*std::max_element(image.levels.back()->dims().begin(), image.levels.back()->dims().end()) > kMaxLastLevel) {
      image.levels.push_back(&image.levels.back()->AddHalf(absl::StrCat(image.prefix, image.levels.size(), "/")));
    }
  }

  ordered_json Place() const {
    const GridSpec& grid = header_.grid;
    return {{"dims", grid.dims},
            {"origin", {grid.origin.x, grid.origin.y, grid.origin.z}},
            {"voxel_size", {grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z}}};
  }

  // The attributes of the root: the place, and the parts.
  ordered_json About() const {
    ordered_json about = Place();
    if (!parts_.table().empty()) about["parts"] = PartsJson(parts_.table());
    return about;
  }

  absl::Status WriteJson(const std::string& name, const ordered_json& json) const {
    // In ASCII: zarr before version 3 reads nothing else.
    const std::string text = json.dump(1, ' ', true, ordered_json::error_handler_t::replace);
    return directory_->WriteFile(name, BytesOf(text + "\n"), job_);
  }

  static ordered_json AxesOf(const Image& image) {
    ordered_json axes = ordered_json::array();
    if (image.components > 1) axes.push_back({{"name", "c"}, {"type", "channel"}});
    for (const char* axis : {"z", "y", "x"}) axes.push_back({{"name", axis}, {"type", "space"}});
    return axes;
  }

  absl::Status WriteArrays(const Image& image) const {
    ordered_json names = ordered_json::array();
    for (const ordered_json& axis : AxesOf(image)) names.push_back(axis["name"]);
    absl::Status s = WriteJson(image.prefix + ".zgroup", {{"zarr_format", 2}});
    for (size_t n = 0; n < image.levels.size() && s.ok(); ++n) {
      const ZarrLevel& level = *image.levels[n];
      const ordered_json array = {{"zarr_format", 2},
                                  {"shape", WithComponents(image, level.dims(), image.components)},
                                  {"chunks", WithComponents(image, level.chunk(), 1)},
                                  {"dtype", std::string(NpyDescr(image.type))},
                                  {"compressor", {{"id", "zlib"}, {"level", kDeflateLevel}}},
                                  {"fill_value", 0},
                                  {"order", "C"},
                                  {"filters", nullptr},
                                  {"dimension_separator", "/"}};
      s = WriteJson(absl::StrCat(image.prefix, n, "/.zarray"), array);
      if (s.ok()) s = WriteJson(absl::StrCat(image.prefix, n, "/.zattrs"), {{"_ARRAY_DIMENSIONS", names}});
    }
    return s;
  }

  absl::Status WriteAttributes(const Image& image, const std::string& name) const {
    ordered_json datasets = ordered_json::array();
    for (size_t n = 0; n < image.levels.size(); ++n) {
      datasets.push_back(
          {{"path", absl::StrCat(n)}, {"coordinateTransformations", Transforms(image.components > 1, n)}});
    }
    const ordered_json multiscale = {{"version", "0.4"},
                                     {"name", name},
                                     {"axes", AxesOf(image)},
                                     {"datasets", datasets},
                                     {"type", "largest magnitude"}};
    ordered_json attributes = {{"multiscales", ordered_json::array({multiscale})}};
    if (image.labels && !parts_.table().empty()) attributes["image-label"] = ImageLabel();
    attributes["voxelpipe"] = image.prefix.empty() ? About() : Place();
    return WriteJson(image.prefix + ".zattrs", attributes);
  }

  // Names and colours of labels as the specification has them.
  ordered_json ImageLabel() const {
    ordered_json colours = ordered_json::array(), properties = colours;
    for (const LegendEntry& entry : LegendOf(parts_.table())) {
      const auto channel = [&](int shift) { return entry.rgb >> shift & 255; };
      colours.push_back({{"label-value", entry.label}, {"rgba", {channel(16), channel(8), channel(0), 255}}});
      properties.push_back({{"label-value", entry.label}, {"name", entry.name}});
    }
    return {{"version", "0.4"}, {"colors", colours}, {"properties", properties}};
  }

  static ordered_json WithComponents(const Image& image, const ZarrLevel::Dims& dims, uint64_t components) {
    ordered_json list = ordered_json::array();
    if (image.components > 1) list.push_back(components);
    for (const uint64_t dim : dims) list.push_back(dim);
    return list;
  }

  // Of indices to the world: to the centres of a level's voxels. A voxel of level n spans 2^n of the grid an axis.
  ordered_json Transforms(bool vector, size_t level) const {
    const Vec3d &h = header_.grid.voxel_size, &o = header_.grid.origin;
    const double step = double(uint64_t{1} << level);
    ordered_json scale = ordered_json::array(), centre = scale;
    if (vector) {
      scale.push_back(1);
      centre.push_back(0);
    }
    for (const double size : {h.z, h.y, h.x}) scale.push_back(size * step);
    for (const auto& [origin, size] : {std::pair{o.z, h.z}, {o.y, h.y}, {o.x, h.x}}) {
      centre.push_back(origin + size * step / 2);
    }
    return {{{"type", "scale"}, {"scale", scale}}, {{"type", "translation"}, {"translation", centre}}};
  }

  std::string path_;
  const JobContext* job_;
  MemoryCharge memory_;
  ResultHeader header_;
  PartReceiver parts_;
  std::optional<AtomicDirectory> directory_;
  std::vector<Image> images_;  // one a target
};

}  // namespace

std::unique_ptr<ResultFile> MakeZarrDirectory(const std::string& path, const JobContext* job) {
  return std::make_unique<ZarrDirectory>(path, job);
}

}  // namespace voxelpipe
