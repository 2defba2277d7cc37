// A page with a viewer of the exposed voxels: one file that needs no network.
//
// The page holds the data as base64 of a zlib stream of:
//   "VXV1", u32 bytes of the description, the description (JSON, padded with spaces to a multiple of 4 with these 8)
//   u16 x 4 a drawn voxel, in linear order: x, y, z, and a bit for each exposed side (-x, +x, -y, +y, -z, +z)
//   for each target of the description its values by voxel and component, u8, u16, u32 or f32
// Each array is padded to a multiple of 4 bytes; numbers are little endian. viewer/payload.js reads it. The inside of
// solids is not written, but follows: a voxel whose +x side is covered has solid ones behind it along x, up to the next
// drawn voxel, which is in the same row. The viewer closes cuts by this. Where the surface has more faces than browsers
// draw fluently, voxels are joined two by two by two: solid if one of them is.
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "encode/drawn/exposed_faces.h"
#include "encode/drawn/whole_file.h"
#include "encode/formats/bytes.h"
#include "encode/formats/deflate.h"
#include "encode/formats/writers.h"
#include "encode/part_json.h"
#include "encode/preview/legend.h"
#include "encode/viewer/viewer_program.h"

namespace voxelpipe {
namespace {

using nlohmann::ordered_json;

constexpr uint64_t kMaxFaces = 2'000'000;
constexpr int64_t kMaxSide = 65'535;  // cells are counted in 16 bits

// A voxel that is drawn.
struct Cell {
  std::array<int64_t, 3> index;
  uint16_t sides;
  uint64_t n;  // of the voxel of the result whose values it has
};

// The first solid voxel of the result in a cell of `step` voxels a side.
uint64_t FirstSolid(const PreviewVolume& volume, const std::array<int64_t, 3>& cell, int64_t step) {
  for (int64_t k = cell[2] * step; k < (cell[2] + 1) * step; ++k) {
    for (int64_t j = cell[1] * step; j < (cell[1] + 1) * step; ++j) {
      for (int64_t i = cell[0] * step; i < (cell[0] + 1) * step; i += 32) {
        const uint32_t word = volume.Row(i, j, k, int(std::min<int64_t>(step, 32)));
        if (word != 0) return volume.Linear(i + std::countr_zero(word), j, k);
      }
    }
  }
  return 0;
}

// The `count` drawn voxels.
absl::StatusOr<std::vector<Cell>> CellsOf(const PreviewVolume& drawn, const PreviewVolume& whole, int64_t step,
                                          uint64_t count, const JobContext* job) {
  std::vector<Cell> cells;
  cells.reserve(count);
  uint64_t last = ~uint64_t{0};
  JobPoll poll(job);
  for (int64_t layer = 0; layer < drawn.layers(); ++layer) {
    const int64_t k = drawn.Layer(layer);
    const absl::Status s = VisitFaces(drawn, k, poll, [&](int64_t i, int64_t j, uint64_t n, int side) {
      if (n != last) cells.push_back({{i, j, k}, 0, step == 1 ? n : FirstSolid(whole, {i, j, k}, step)});
      last = n;
      cells.back().sides |= uint16_t(1 << side);
    });
    if (!s.ok()) return s;
  }
  return cells;
}

// How the viewer makes a colour of the values (viewer/colours.js).
std::string_view ShownAs(const TargetSpec& spec, const VoxelizeResult& result) {
  if (HoldsLabels(spec, result.kind) && !result.parts.empty()) return "label";
  if (spec.components < 3 || !(ColourUnit(spec) > 0)) return "number";
  if (spec.shader.name == "velocity") return "length";
  if (spec.encoding != Encoding::kLinear) return "codes";
  if (spec.shader.name == "normal" || spec.shader.name == "geometric_normal") return "unit_vector";
  return "linear";
}

std::string_view StoredAs(VoxelFormat format) {
  switch (format) {
    case VoxelFormat::kU8: return "u8";
    case VoxelFormat::kU16: return "u16";
    case VoxelFormat::kU32: return "u32";
    default: return "f32";
  }
}

void PutPadding(Bytes& bytes) {
  bytes.Padded("", (4 - bytes.size() % 4) % 4);
}

void PutValues(const TargetValues& values, const TargetSpec& spec, const PreviewItems& items,
               const std::vector<Cell>& cells, Bytes& bytes) {
  for (const Cell& cell : cells) {
    const uint64_t item = items.Find(cell.n);
    for (int c = 0; c < spec.components; ++c) {
      switch (spec.format) {
        case VoxelFormat::kU8: bytes.Put(uint8_t(values.At(item, c))); break;
        case VoxelFormat::kU16: bytes.Put(uint16_t(values.At(item, c))); break;
        case VoxelFormat::kU32: bytes.Put(values.WordAt(item, c)); break;
        default: bytes.Put(values.At(item, c)); break;
      }
    }
  }
  PutPadding(bytes);
}

std::string Three(const Vec3d& v) {
  return absl::StrCat(v.x, ", ", v.y, ", ", v.z);
}

// The parts by label: what the viewer lists.
ordered_json LabelsOf(const PartTable& parts) {
  ordered_json labels = ordered_json::array();
  for (const LegendEntry& entry : LegendOf(parts)) {
    ordered_json& label = labels.emplace_back(ordered_json{{"label", entry.label},
                                                           {"name", entry.name},
                                                           {"colour", entry.rgb},
                                                           {"parts", entry.parts},
                                                           {"triangles", entry.triangles}});
    if (!parts.voxels.empty()) label["voxels"] = entry.voxels;
  }
  return labels;
}

ordered_json Describe(const VoxelizeResult& result, const PreviewVolume& drawn, int64_t step, uint64_t solid,
                      uint64_t whole_faces, uint64_t cells) {
  const GridSpec& grid = result.grid;
  const Vec3d &o = grid.origin, h = grid.voxel_size * double(step);
  ordered_json json;
  json["title"] = absl::StrCat(grid.dims[0], " x ", grid.dims[1], " x ", grid.dims[2], " voxels of ",
                               Three(grid.voxel_size), "\norigin ", Three(o), "\n", solid, " solid voxels");
  json["dims"] = drawn.dims();
  json["origin"] = {o.x, o.y, o.z};
  json["voxel_size"] = {h.x, h.y, h.z};
  json["step"] = step;
  json["whole_faces"] = whole_faces;
  json["voxels"] = cells;
  json["targets"] = ordered_json::array();
  for (size_t t = 0; t < result.specs.size(); ++t) {
    const TargetSpec& spec = result.specs[t];
    if (spec.format == VoxelFormat::kBit) continue;
    json["targets"].push_back(
        {{"name", absl::StrCat("target", t)},
         {"title", absl::StrCat(std::string(Name(spec.format)), "x", spec.components, " ", spec.shader.name)},
         {"format", StoredAs(spec.format)},
         {"components", spec.components},
         {"shows", ShownAs(spec, result)},
         {"unit", ColourUnit(spec)}});
  }
  if (!result.parts.empty()) json["labels"] = LabelsOf(result.parts);
  return json;
}

// Writes text as base64. Call Finish once, last.
class Base64Writer {
 public:
  Base64Writer(AtomicFile& file, const JobContext* job) : file_(file), job_(job) {}

  absl::Status Write(std::span<const uint8_t> bytes) {
    open_.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const size_t whole = open_.size() / 3 * 3;
    absl::Status s = file_.Write(BytesOf(absl::Base64Escape({open_.data(), whole})), job_);
    open_.erase(0, whole);
    return s;
  }
  absl::Status Finish() { return file_.Write(BytesOf(absl::Base64Escape(open_)), job_); }

 private:
  AtomicFile& file_;
  const JobContext* job_;
  std::string open_;  // up to two bytes that a third has to follow
};

absl::Status EncodeHtml(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  const VoxelizeResult& result = drawn.result;
  const PreviewVolume* shown = &drawn.volume;
  std::unique_ptr<const PreviewVolume> half;
  absl::StatusOr<FaceCount> count = CountFaces(drawn.volume, job);
  if (!count.ok()) return count.status();
  const uint64_t whole_faces = count->faces;
  int64_t step = 1;
  while (count->faces > kMaxFaces || *std::max_element(shown->dims().begin(), shown->dims().end()) > kMaxSide) {
    absl::StatusOr<PreviewVolume> next = PreviewVolume::Halved(*shown, job);
    if (!next.ok()) return next.status();
    half = std::make_unique<const PreviewVolume>(*std::move(next));
    shown = half.get();
    step *= 2;
    count = CountFaces(*shown, job);
    if (!count.ok()) return count.status();
  }
  const absl::StatusOr<uint64_t> solid = CountSolid(drawn.volume, job);
  if (!solid.ok()) return solid.status();
  absl::Status s =
      drawn.memory.Grow(LegendBytes(result.parts.shape()) + PartsJsonBytes(result.parts.shape()), "a page of voxels:");
  if (!s.ok()) return s;
  std::string json = Describe(result, *shown, step, *solid, whole_faces, count->voxels).dump();
  json.resize((json.size() + 3) / 4 * 4, ' ');
  constexpr uint64_t kCellBytes = 4 * sizeof(uint16_t), kPadding = 4;
  uint64_t payload = 2 * sizeof(uint32_t) + json.size() + kCellBytes * count->voxels;
  for (const TargetSpec& spec : result.specs) {
    const ElementType type = ElementOf(spec.format == VoxelFormat::kF16 ? VoxelFormat::kF32 : spec.format);
    payload += ArrayBytes(type, count->voxels * uint64_t(spec.components)) + kPadding;
  }
  s = drawn.memory.Grow(count->voxels, sizeof(Cell), "a page of voxels:");
  if (s.ok()) s = drawn.memory.Grow(payload + kDeflateBytes, "a page of voxels:");
  if (!s.ok()) return s;
  const absl::StatusOr<std::vector<Cell>> cells = CellsOf(*shown, drawn.volume, step, count->voxels, job);
  if (!cells.ok()) return cells.status();
  Bytes bytes;
  bytes.Reserve(payload);
  bytes.Text("VXV1").Put(uint32_t(json.size())).Text(json);
  for (const Cell& cell : *cells) {
    for (const int64_t index : cell.index) bytes.Put(uint16_t(index));
    bytes.Put(cell.sides);
  }
  const PreviewItems& items = drawn.colours.items();
  for (size_t t = 0; t < result.specs.size(); ++t) {
    const TargetSpec& spec = result.specs[t];
    if (absl::Status over = CheckJob(job); !over.ok()) return over;
    if (spec.format != VoxelFormat::kBit) PutValues({result, t, items.count()}, spec, items, *cells, bytes);
  }
  s = file.Write(BytesOf(ViewerPage()), job);
  if (s.ok()) s = file.Write(BytesOf("<script type=\"application/octet-stream\" id=\"voxels\">"), job);
  Base64Writer text(file, job);
  if (s.ok()) s = DeflateBlock(bytes.span(), job, [&](std::span<const uint8_t> piece) { return text.Write(piece); });
  if (s.ok()) s = text.Finish();
  for (const std::string_view part : {std::string_view("</script>\n<script type=\"module\">"), ViewerScript(),
                                      std::string_view("</script>\n</body>\n</html>\n")}) {
    if (s.ok()) s = file.Write(BytesOf(part), job);
  }
  return s;
}

}  // namespace

std::unique_ptr<ResultFile> MakeHtmlFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".html", path, job, &EncodeHtml);
}

}  // namespace voxelpipe
