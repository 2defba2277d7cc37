// Polygon file format: the centres of voxels as points with properties.
//
// Source: G. Turk, "The PLY Polygon File Format", 1994.
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/drawn/whole_file.h"
#include "encode/formats/bytes.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

constexpr size_t kPieceBytes = 1 << 20;

// A component of a target as a property of every point.
struct Property {
  size_t target;
  int component;
  VoxelFormat format;
};

std::string_view TypeOf(VoxelFormat format) {
  switch (format) {
    case VoxelFormat::kU16: return "uint16";
    case VoxelFormat::kU32: return "uint32";
    case VoxelFormat::kF16:
    case VoxelFormat::kF32: return "float";
    default: return "uint8";
  }
}

class PlyEncoder {
 public:
  PlyEncoder(const DrawnResult& drawn, AtomicFile& file, const JobContext* job)
      : drawn_(drawn), result_(drawn.result), items_(drawn.colours.items()), file_(file), job_(job) {
    for (size_t t = 0; t < result_.specs.size(); ++t) {
      values_.emplace_back(result_, t, items_.count());
      for (int c = 0; c < result_.specs[t].components; ++c) properties_.push_back({t, c, result_.specs[t].format});
    }
  }

  absl::Status Run() {
    const bool buckets = result_.kind == ResultKind::kBuckets;
    const absl::StatusOr<uint64_t> solid = CountSolid(drawn_.volume, job_);
    if (!solid.ok()) return solid.status();
    absl::Status s = drawn_.memory.Grow(2 * kPieceBytes, "points:");
    if (s.ok()) s = file_.Write(BytesOf(Header(buckets, *solid)), job_);
    if (!s.ok()) return s;
    absl::Status written;
    s = VisitVoxels(drawn_.volume, job_, [&](int64_t i, int64_t j, int64_t k, uint64_t n) {
      const uint64_t last = items_.Find(n);
      for (uint64_t item = buckets ? last + 1 - items_.FragmentsOf(n) : last; item <= last && written.ok(); ++item) {
        PutPoint({i, j, k}, n, item);
        if (bytes_.size() >= kPieceBytes) written = Flush();
      }
    });
    s.Update(written);
    return s.ok() ? Flush() : s;
  }

 private:
  std::string Header(bool buckets, uint64_t solid) const {
    const GridSpec& grid = result_.grid;
    const auto vector = [](const Vec3d& v) {
      return absl::StrCat(Shortest(v.x), " ", Shortest(v.y), " ", Shortest(v.z));
    };
    std::string head = absl::StrCat(
        "ply\nformat binary_little_endian 1.0\ncomment voxelpipe: ", buckets ? "fragments" : "occupied voxels",
        ", x y z is the centre, i j k the index of the voxel\ncomment dims ", grid.dims[0], " ", grid.dims[1], " ",
        grid.dims[2], "\ncomment origin ", vector(grid.origin), "\ncomment voxel_size ", vector(grid.voxel_size),
        "\nelement vertex ", buckets ? result_.listed_fragments() : solid,
        "\nproperty double x\nproperty double y\nproperty double z\nproperty int32 i\nproperty int32 j\nproperty "
        "int32 k\n");
    if (drawn_.colours.has_colours()) {
      absl::StrAppend(&head, "property uint8 red\nproperty uint8 green\nproperty uint8 blue\n");
    }
    if (buckets) absl::StrAppend(&head, "property uint32 triangle\n");
    for (const Property& property : properties_) {
      absl::StrAppend(&head, "property ", std::string(TypeOf(property.format)), " target", property.target);
      if (result_.specs[property.target].components > 1) absl::StrAppend(&head, "_", property.component);
      absl::StrAppend(&head, "\n");
    }
    return head + "end_header\n";
  }

  void PutPoint(const std::array<int64_t, 3>& index, uint64_t n, uint64_t item) {
    const Vec3d &origin = result_.grid.origin, &size = result_.grid.voxel_size;
    for (int a = 0; a < 3; ++a) bytes_.Put(origin[a] + (double(index[size_t(a)]) + 0.5) * size[a]);
    for (const int64_t number : index) bytes_.Put(int32_t(number));
    if (drawn_.colours.has_colours()) {
      const uint32_t rgb = SrgbCodes(drawn_.colours.At(n));
      bytes_.Put(uint8_t(rgb >> 16)).Put(uint8_t(rgb >> 8)).Put(uint8_t(rgb));
    }
    if (result_.kind == ResultKind::kBuckets) {
      uint32_t triangle;
      std::memcpy(&triangle, result_.triangles.data() + item * sizeof triangle, sizeof triangle);
      bytes_.Put(triangle);
    }
    for (const Property& property : properties_) PutValue(property, item);
  }

  void PutValue(const Property& property, uint64_t item) {
    const uint8_t* const data = result_.targets[property.target].data();
    if (property.format == VoxelFormat::kBit) {
      bytes_.Put(uint8_t((data[item / 8] >> (item % 8)) & 1));
      return;
    }
    const TargetValues& values = values_[property.target];
    switch (property.format) {
      case VoxelFormat::kU8: bytes_.Put(uint8_t(values.At(item, property.component))); break;
      case VoxelFormat::kU16: bytes_.Put(uint16_t(values.At(item, property.component))); break;
      case VoxelFormat::kU32: bytes_.Put(values.WordAt(item, property.component)); break;
      default: bytes_.Put(values.At(item, property.component)); break;
    }
  }

  absl::Status Flush() {
    absl::Status status = file_.Write(bytes_.span(), job_);
    bytes_.clear();
    return status;
  }

  const DrawnResult& drawn_;
  const VoxelizeResult& result_;
  const PreviewItems& items_;
  AtomicFile& file_;
  const JobContext* job_;
  std::vector<TargetValues> values_;  // one a target
  std::vector<Property> properties_;
  Bytes bytes_;
};

absl::Status EncodePly(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  return PlyEncoder(drawn, file, job).Run();
}

}  // namespace

std::unique_ptr<ResultFile> MakePlyFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".ply", path, job, &EncodePly);
}

}  // namespace voxelpipe
