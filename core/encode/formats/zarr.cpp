// OME-Zarr 0.4 in a directory: Zarr version 2 with coordinates.
//
// Sources: A. Miles et al., "Zarr storage specification version 2"; J. Moore et al., "OME-NGFF specification 0.4",
// 2022 (ngff.openmicroscopy.org).
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/atomic_directory.h"
#include "encode/format_registry.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/writers.h"
#include "encode/npy.h"

namespace voxelpipe {
namespace {

using nlohmann::ordered_json;

constexpr std::array<uint64_t, 3> kMaxChunk = {16, 256, 256};  // z, y, x

class ZarrDirectory final : public ResultFile {
 public:
  ZarrDirectory(std::string path, const JobContext* job) : path_(std::move(path)), job_(job) {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(".zarr", header.kind, header.specs.size()); !s.ok()) return s;
    header_ = header;
    for (size_t a = 0; a < 3; ++a) {
      dims_[a] = uint64_t(header.grid.dims[2 - a]);
      chunk_[a] = std::min(kMaxChunk[a], dims_[a]);
    }
    absl::StatusOr<AtomicDirectory> directory = AtomicDirectory::Create(path_, ".zgroup");
    if (!directory.ok()) return directory.status();
    directory_.emplace(*std::move(directory));
    const bool several = header.arrays.size() > 1;
    if (several) {
      if (absl::Status s = WriteJson(".zgroup", {{"zarr_format", 2}}); !s.ok()) return s;
      if (absl::Status s = WriteJson(".zattrs", {{"voxelpipe", Place()}}); !s.ok()) return s;
    }
    for (size_t i = 0; i < header.arrays.size(); ++i) {
      Image image;
      image.prefix = several ? header.arrays[i].name + "/" : "";
      image.type = header.arrays[i].type;
      image.components = uint64_t(header.specs[i].components);
      image.elements.emplace(image.type, header.grid.voxels() * image.components);
      if (absl::Status s = WriteMetadata(image, header.arrays[i].name); !s.ok()) return s;
      images_.push_back(std::move(image));
    }
    return absl::OkStatus();
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    Image& image = images_[array];
    return image.elements->Write(bytes, [&](std::span<const uint8_t> stored) {
      while (!stored.empty()) {
        const uint64_t whole = SlabBytes(image);
        const std::span<const uint8_t> piece =
            stored.first(size_t(std::min<uint64_t>(stored.size(), whole - slab_.size())));
        slab_.insert(slab_.end(), piece.begin(), piece.end());
        stored = stored.subspan(piece.size());
        if (slab_.size() < whole) break;
        if (absl::Status s = WriteSlab(image); !s.ok()) return s;
      }
      return absl::OkStatus();
    });
  }

  absl::Status Commit() override {
    for (const Image& image : images_) {
      if (image.planes_done < Planes(image)) return absl::InternalError("the result is not complete");
    }
    return directory_->Commit();
  }

 private:
  // A target: a group with the array 0.
  struct Image {
    std::string prefix;
    ElementType type;
    uint64_t components;
    std::optional<NpyElements> elements;
    uint64_t planes_done = 0, layers_done = 0;  // layers of the present plane
  };

  // Arrays that arrive one after the other: the components of a planar target.
  uint64_t Planes(const Image& image) const { return header_.layout == Layout::kPlanar ? image.components : 1; }
  uint64_t Together(const Image& image) const { return image.components / Planes(image); }
  uint64_t SlabLayers(const Image& image) const { return std::min(chunk_[0], dims_[0] - image.layers_done); }
  uint64_t SlabBytes(const Image& image) const {
    return NpyBytes(image.type, SlabLayers(image) * dims_[1] * dims_[2] * Together(image));
  }

  ordered_json Place() const {
    const GridSpec& grid = header_.grid;
    return {{"dims", grid.dims},
            {"origin", {grid.origin.x, grid.origin.y, grid.origin.z}},
            {"voxel_size", {grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z}}};
  }

  absl::Status WriteJson(const std::string& name, const ordered_json& json) const {
    return directory_->WriteFile(name, BytesOf(json.dump(1) + "\n"), job_);
  }

  absl::Status WriteMetadata(const Image& image, const std::string& name) const {
    const Vec3d &h = header_.grid.voxel_size, &o = header_.grid.origin;
    ordered_json axes = ordered_json::array(), names = axes, scale = axes, centre = axes, shape = axes, chunks = axes;
    const auto add = [&](const char* axis, bool space, double step, double first, uint64_t size, uint64_t chunk) {
      axes.push_back(space ? ordered_json{{"name", axis}, {"type", "space"}, {"unit", "meter"}}
                           : ordered_json{{"name", axis}, {"type", "channel"}});
      names.push_back(axis);
      scale.push_back(step);
      centre.push_back(first);
      shape.push_back(size);
      chunks.push_back(chunk);
    };
    if (image.components > 1) add("c", false, 1, 0, image.components, 1);
    add("z", true, h.z, o.z + h.z / 2, dims_[0], chunk_[0]);
    add("y", true, h.y, o.y + h.y / 2, dims_[1], chunk_[1]);
    add("x", true, h.x, o.x + h.x / 2, dims_[2], chunk_[2]);
    const ordered_json transforms = {{{"type", "scale"}, {"scale", scale}},
                                     {{"type", "translation"}, {"translation", centre}}};
    const ordered_json multiscale = {
        {"version", "0.4"},
        {"name", name},
        {"axes", axes},
        {"datasets", ordered_json::array({{{"path", "0"}, {"coordinateTransformations", transforms}}})}};
    const ordered_json attributes = {{"multiscales", ordered_json::array({multiscale})}, {"voxelpipe", Place()}};
    const ordered_json array = {{"zarr_format", 2},
                                {"shape", shape},
                                {"chunks", chunks},
                                {"dtype", std::string(NpyDescr(image.type))},
                                {"compressor", {{"id", "zlib"}, {"level", kDeflateLevel}}},
                                {"fill_value", 0},
                                {"order", "C"},
                                {"filters", nullptr},
                                {"dimension_separator", "/"}};
    absl::Status s = WriteJson(image.prefix + ".zgroup", {{"zarr_format", 2}});
    if (s.ok()) s = WriteJson(image.prefix + ".zattrs", attributes);
    if (s.ok()) s = WriteJson(image.prefix + "0/.zarray", array);
    if (s.ok()) s = WriteJson(image.prefix + "0/.zattrs", {{"_ARRAY_DIMENSIONS", names}});
    return s;
  }

  // A row of chunks along z, of all components that arrive together.
  absl::Status WriteSlab(Image& image) {
    const uint64_t rows = (dims_[1] + chunk_[1] - 1) / chunk_[1], columns = (dims_[2] + chunk_[2] - 1) / chunk_[2];
    std::mutex mutex;
    absl::Status first;
    tbb::parallel_for(uint64_t{0}, Together(image) * rows * columns, [&](uint64_t n) {
      const absl::Status s = WriteChunk(image, n / columns / rows, n / columns % rows, n % columns);
      const std::lock_guard lock(mutex);
      first.Update(s);
    });
    image.layers_done += SlabLayers(image);
    slab_.clear();
    if (image.layers_done == dims_[0]) {
      image.layers_done = 0;
      ++image.planes_done;
    }
    return first;
  }

  // Chunks of Zarr are whole: those at the end of an axis are filled up with zeros. One of zeros only is left out.
  absl::Status WriteChunk(const Image& image, uint64_t component, uint64_t row, uint64_t column) const {
    const uint64_t bytes = NpyBytes(image.type, 1), together = Together(image);
    const uint64_t layers = SlabLayers(image);
    const uint64_t y0 = row * chunk_[1], x0 = column * chunk_[2];
    const uint64_t ny = std::min(chunk_[1], dims_[1] - y0), nx = std::min(chunk_[2], dims_[2] - x0);
    std::vector<uint8_t> chunk(chunk_[0] * chunk_[1] * chunk_[2] * bytes);
    for (uint64_t k = 0; k < layers; ++k) {
      for (uint64_t j = 0; j < ny; ++j) {
        uint8_t* to = &chunk[(k * chunk_[1] + j) * chunk_[2] * bytes];
        const uint8_t* from = &slab_[(((k * dims_[1] + y0 + j) * dims_[2] + x0) * together + component) * bytes];
        if (together == 1) {
          std::memcpy(to, from, nx * bytes);
          continue;
        }
        for (uint64_t i = 0; i < nx; ++i, to += bytes, from += together * bytes) std::memcpy(to, from, bytes);
      }
    }
    if (std::all_of(chunk.begin(), chunk.end(), [](uint8_t byte) { return byte == 0; })) return absl::OkStatus();
    std::string name = image.prefix + "0/";
    if (image.components > 1) absl::StrAppend(&name, together > 1 ? component : image.planes_done, "/");
    absl::StrAppend(&name, image.layers_done / chunk_[0], "/", row, "/", column);
    return directory_->WriteFile(name, ZlibBlock(chunk), job_);
  }

  std::string path_;
  const JobContext* job_;
  ResultHeader header_;
  std::array<uint64_t, 3> dims_{}, chunk_{};  // z, y, x
  std::optional<AtomicDirectory> directory_;
  std::vector<Image> images_;  // one a target
  std::vector<uint8_t> slab_;  // layers of the image that receives
};

}  // namespace

std::unique_ptr<ResultFile> MakeZarrDirectory(const std::string& path, const JobContext* job) {
  return std::make_unique<ZarrDirectory>(path, job);
}

}  // namespace voxelpipe
