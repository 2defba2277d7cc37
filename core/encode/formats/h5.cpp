// HDF5 as codes for electromagnetic fields (FDTD) read a geometry.
//
// Sources: C. Warren et al., "gprMax: user guide", #geometry_objects_read (docs.gprmax.com): `data`, 16-bit numbers of
// materials from 0, -1 for none, and `dx_dy_dz`; A. Oskooi et al., "Meep: Python interface", epsilon_input_file: a
// dataset of numbers. Both have x as the slowest axis.
#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "encode/formats/deflate.h"
#include "encode/formats/plain_elements.h"
#include "encode/formats/writers.h"
#include "job/job_work.h"
#include "job/part_receiver.h"

namespace voxelpipe {
namespace {

constexpr hsize_t kChunk = 64, kLayers = 32;  // voxels along x and y, and along z
constexpr uint64_t kLibraryBytes = 4 << 20;   // its cache of chunks and the steps in which a file grows

// An identifier of the library, closed by the function of its kind.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)), close_(other.close_) {}
  Handle& operator=(Handle&&) = delete;
  ~Handle() {
    if (id_ >= 0) close_(id_);
  }
  hid_t get() const { return id_; }
  bool ok() const { return id_ >= 0; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

absl::Status Failed(std::string_view what) {
  return absl::InternalError(absl::StrCat(".h5: HDF5 cannot make ", std::string(what)));
}

// Numbers in one dimension, as an attribute of the file.
absl::Status PutAttribute(const Handle& file, const char* name, hid_t type, const std::array<hsize_t, 1>& count,
                          const void* numbers) {
  const Handle space(H5Screate_simple(1, count.data(), nullptr), &H5Sclose);
  const Handle attribute(H5Acreate2(file.get(), name, type, space.get(), H5P_DEFAULT, H5P_DEFAULT), &H5Aclose);
  return attribute.ok() && H5Awrite(attribute.get(), type, numbers) >= 0 ? absl::OkStatus() : Failed(name);
}

// Without times, so that equal results are equal files.
Handle WithoutTimes() {
  Handle properties(H5Pcreate(H5P_DATASET_CREATE), &H5Pclose);
  H5Pset_obj_track_times(properties.get(), false);
  return properties;
}

absl::Status PutColumn(const Handle& group, const char* name, hid_t type, hsize_t count, const void* numbers) {
  const Handle space(H5Screate_simple(1, &count, nullptr), &H5Sclose);
  const Handle properties = WithoutTimes();
  const Handle set(H5Dcreate2(group.get(), name, type, space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT),
                   &H5Dclose);
  return set.ok() && H5Dwrite(set.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers) >= 0 ? absl::OkStatus()
                                                                                            : Failed(name);
}

absl::Status PutNames(const Handle& group, const PartTable& parts) {
  std::vector<std::string> names;
  names.reserve(parts.size());
  for (size_t i = 0; i < parts.size(); ++i) names.push_back(CleanText(parts.Name(i)));
  std::vector<const char*> texts;
  texts.reserve(names.size());
  for (const std::string& name : names) texts.push_back(name.c_str());
  const Handle type(H5Tcopy(H5T_C_S1), &H5Tclose);
  H5Tset_size(type.get(), H5T_VARIABLE);
  H5Tset_cset(type.get(), H5T_CSET_UTF8);
  return PutColumn(group, "name", type.get(), texts.size(), texts.data());
}

absl::Status PutParts(const Handle& file, const PartTable& parts) {
  const Handle group(H5Gcreate2(file.get(), "parts", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), &H5Gclose);
  if (!group.ok()) return Failed("parts");
  const hsize_t count = parts.size();
  absl::Status s = PutColumn(group, "label", H5T_NATIVE_UINT32, count, parts.label.data());
  if (s.ok()) s = PutColumn(group, "priority", H5T_NATIVE_INT32, count, parts.priority.data());
  if (s.ok()) s = PutColumn(group, "triangles", H5T_NATIVE_UINT64, count, parts.triangles.data());
  if (!parts.voxels.empty()) {
    if (s.ok()) s = PutColumn(group, "open_edges", H5T_NATIVE_UINT64, count, parts.open_edges.data());
    if (s.ok()) s = PutColumn(group, "odd_columns", H5T_NATIVE_UINT64, count, parts.odd_columns.data());
    if (s.ok()) s = PutColumn(group, "voxels", H5T_NATIVE_UINT64, count, parts.voxels.data());
  }
  return s.ok() ? PutNames(group, parts) : s;
}

// The file is made in memory, as the library writes back and forth in it.
class H5File final : public ResultFile {
 public:
  H5File(std::string path, const JobContext* job)
      : path_(std::move(path)), job_(job), memory_(&MemoryOf(job)), file_memory_(&MemoryOf(job)) {}

  absl::Status Begin(const ResultHeader& header) override {
    if (absl::Status s = CheckHolds(".h5", header.kind, header.specs); !s.ok()) return s;
    header_ = header;
    const ElementType type = header.arrays[0].type;
    plain_bytes_ = ArrayBytes(PlainTypeOf(type), 1);
    for (size_t a = 0; a < 3; ++a) dims_[a] = hsize_t(header.grid.dims[a]);
    layers_ = std::min(kLayers, dims_[2]);
    const uint64_t slab = dims_[0] * dims_[1] * layers_;
    const PartShape shape = header.parts();
    const uint64_t parts = 2 * PartReceiver::MemoryBytes(header) + shape.parts * sizeof(std::string);
    absl::Status s = memory_.Grow(slab * (plain_bytes_ + value_bytes()) + parts + kLibraryBytes +
                                      PlainElements::MemoryBytes(type, header.grid.voxels()),
                                  "layers of a file:");
    if (!s.ok()) return s;
    absl::StatusOr<AtomicFile> output = path_.empty() ? AtomicFile::StandardOutput() : AtomicFile::Create(path_, job_);
    if (!output.ok()) return output.status();
    output_.emplace(*std::move(output));
    parts_.Begin(header);
    elements_.emplace(type, header.grid.voxels());
    slab_.reserve(slab * plain_bytes_);
    return Create();
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (parts_.Take(array, bytes) || array > 0) return absl::OkStatus();
    return elements_->Write(bytes, [this](std::span<const uint8_t> plain) {
      while (!plain.empty()) {
        const uint64_t whole = dims_[0] * dims_[1] * std::min(layers_, dims_[2] - first_layer_) * plain_bytes_;
        const std::span<const uint8_t> piece = plain.first(std::min<size_t>(plain.size(), whole - slab_.size()));
        slab_.insert(slab_.end(), piece.begin(), piece.end());
        plain = plain.subspan(piece.size());
        if (slab_.size() < whole) break;
        if (absl::Status s = WriteSlab(); !s.ok()) return s;
      }
      return absl::OkStatus();
    });
  }

  absl::Status Commit() override {
    if (first_layer_ < dims_[2]) return absl::InternalError(absl::StrCat("'", path_, "': the result is not complete"));
    if (!parts_.table().empty()) {
      if (absl::Status s = PutParts(*file_, parts_.table()); !s.ok()) return s;
    }
    data_.reset();
    if (H5Fflush(file_->get(), H5F_SCOPE_LOCAL) < 0) return Failed("the file");
    const ssize_t bytes = H5Fget_file_image(file_->get(), nullptr, 0);
    if (bytes < 0) return Failed("the file");
    if (absl::Status s = memory_.Grow(uint64_t(bytes), "a file:"); !s.ok()) return s;
    std::vector<uint8_t> image(static_cast<size_t>(bytes));
    if (H5Fget_file_image(file_->get(), image.data(), image.size()) != bytes) return Failed("the file");
    file_.reset();
    absl::Status s = output_->Write(image, job_);
    return s.ok() ? output_->Commit() : s;
  }

 private:
  // Numbers of materials, or floats as they are.
  bool floats() const { return PlainTypeOf(header_.arrays[0].type) == ElementType::kF32; }
  uint64_t value_bytes() const { return floats() ? sizeof(float) : sizeof(int16_t); }
  hid_t value_type() const { return floats() ? H5T_NATIVE_FLOAT : H5T_NATIVE_INT16; }

  absl::Status Create() {
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // of this thread: errors are statuses, not lines on stderr
    const Handle in_memory(H5Pcreate(H5P_FILE_ACCESS), &H5Pclose);
    H5Pset_fapl_core(in_memory.get(), 1 << 20, false);
    file_.emplace(H5Fcreate("voxelpipe", H5F_ACC_TRUNC, H5P_DEFAULT, in_memory.get()), &H5Fclose);
    if (!file_->ok()) return Failed("a file");
    const GridSpec& grid = header_.grid;
    const std::array<double, 3> size = {grid.voxel_size.x, grid.voxel_size.y, grid.voxel_size.z};
    const std::array<double, 3> origin = {grid.origin.x, grid.origin.y, grid.origin.z};
    absl::Status s = PutAttribute(*file_, "dx_dy_dz", H5T_NATIVE_DOUBLE, {3}, size.data());
    if (s.ok()) s = PutAttribute(*file_, "origin", H5T_NATIVE_DOUBLE, {3}, origin.data());
    if (!s.ok()) return s;
    const Handle space(H5Screate_simple(3, dims_.data(), nullptr), &H5Sclose);
    const Handle properties = WithoutTimes();
    const std::array<hsize_t, 3> chunk = {std::min(kChunk, dims_[0]), std::min(kChunk, dims_[1]), layers_};
    H5Pset_chunk(properties.get(), 3, chunk.data());
    H5Pset_deflate(properties.get(), kDeflateLevel);
    data_.emplace(
        H5Dcreate2(file_->get(), "data", value_type(), space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT),
        &H5Dclose);
    return data_->ok() ? absl::OkStatus() : Failed("data");
  }

  // The layers in slab_, turned so that z is the fastest axis.
  template <typename Plain, typename Value, typename Convert>
  absl::Status Turn(std::vector<uint8_t>& values, const Convert& convert) {
    const hsize_t nx = dims_[0], ny = dims_[1], nz = slab_.size() / (nx * ny * sizeof(Plain));
    JobPoll poll(job_);
    for (hsize_t k = 0; k < nz; ++k) {
      for (hsize_t j = 0; j < ny; ++j) {
        for (hsize_t i = 0; i < nx; ++i) {
          Plain plain;
          std::memcpy(&plain, slab_.data() + ((k * ny + j) * nx + i) * sizeof plain, sizeof plain);
          const std::optional<Value> value = convert(plain);
          if (!value) {
            return absl::InvalidArgumentError(absl::StrCat(".h5 holds numbers of materials up to ", kMaxLabel,
                                                           "; a voxel has ", plain, "; .npz and .zarr hold it"));
          }
          std::memcpy(values.data() + ((i * ny + j) * nz + k) * sizeof(Value), &*value, sizeof(Value));
        }
        if (absl::Status s = poll.Add(nx); !s.ok()) return s;
      }
    }
    return absl::OkStatus();
  }

  absl::Status TurnSlab(std::vector<uint8_t>& values) {
    const auto material = [](uint32_t label) -> std::optional<int16_t> {
      if (label > kMaxLabel) return std::nullopt;
      return int16_t(int32_t(label) - 1);
    };
    switch (PlainTypeOf(header_.arrays[0].type)) {
      case ElementType::kF32:
        return Turn<float, float>(values, [](float value) -> std::optional<float> { return value; });
      case ElementType::kU32: return Turn<uint32_t, int16_t>(values, material);
      case ElementType::kU16: return Turn<uint16_t, int16_t>(values, material);
      default: return Turn<uint8_t, int16_t>(values, material);
    }
  }

  absl::Status WriteSlab() {
    const hsize_t layers = slab_.size() / (dims_[0] * dims_[1] * plain_bytes_);
    std::vector<uint8_t> values(dims_[0] * dims_[1] * layers * value_bytes());
    if (absl::Status s = TurnSlab(values); !s.ok()) return s;
    // The slab may grow the file by as much, compressed or not.
    hsize_t made = 0;
    H5Fget_filesize(file_->get(), &made);
    const uint64_t most = std::max<uint64_t>(made + values.size(), file_memory_.bytes());
    if (absl::Status s = file_memory_.Grow(most - file_memory_.bytes(), "a file:"); !s.ok()) return s;
    const std::array<hsize_t, 3> from = {0, 0, first_layer_}, count = {dims_[0], dims_[1], layers};
    const Handle memory(H5Screate_simple(3, count.data(), nullptr), &H5Sclose);
    const Handle place(H5Dget_space(data_->get()), &H5Sclose);
    H5Sselect_hyperslab(place.get(), H5S_SELECT_SET, from.data(), nullptr, count.data(), nullptr);
    if (H5Dwrite(data_->get(), value_type(), memory.get(), place.get(), H5P_DEFAULT, values.data()) < 0) {
      return Failed("data");
    }
    first_layer_ += layers;
    slab_.clear();
    return CheckJob(job_);
  }

  static constexpr uint32_t kMaxLabel = uint32_t(std::numeric_limits<int16_t>::max()) + 1;

  std::string path_;
  const JobContext* job_;
  MemoryCharge memory_, file_memory_;
  ResultHeader header_;
  std::array<hsize_t, 3> dims_{};
  hsize_t layers_ = 1, first_layer_ = 0;  // of a slab; of the one in slab_
  uint64_t plain_bytes_ = 1;
  std::optional<AtomicFile> output_;
  PartReceiver parts_;
  std::optional<PlainElements> elements_;
  std::vector<uint8_t> slab_;
  std::optional<Handle> file_, data_;  // data_ is closed first
};

}  // namespace

std::unique_ptr<ResultFile> MakeH5File(const std::string& path, const JobContext* job) {
  return std::make_unique<H5File>(path, job);
}

}  // namespace voxelpipe
