// glTF 2.0, binary: the exposed faces of the solid voxels, each or merged, with the voxels' colours at shared vertices.
//
// Source: Khronos Group, "glTF 2.0 Specification", 2021. Positions count in voxels, which floats hold exactly, and the
// node places them in the world. There are no normals: viewers then shade each face flat, as glTF has it.
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_cat.h"
#include "encode/drawn/exposed_faces.h"
#include "encode/drawn/merged_faces.h"
#include "encode/drawn/whole_file.h"
#include "encode/formats/bytes.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

using nlohmann::ordered_json;

constexpr int kFloat = 5126, kUnsignedInt = 5125, kUnsignedShort = 5123;  // component types
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;
constexpr uint64_t kMaxFileBytes = std::numeric_limits<uint32_t>::max();

// Linear, in 16 bits; the fourth is 1.
using Colour = std::array<uint16_t, 4>;

Colour ColourOf(const Vec3f& linear) {
  const auto code = [](float v) { return uint16_t(std::lround(std::clamp(v, 0.0f, 1.0f) * 65535)); };
  return {code(linear.x), code(linear.y), code(linear.z), 65535};
}

uint64_t BitsOf(const Colour& colour) {
  uint64_t bits;
  std::memcpy(&bits, colour.data(), sizeof bits);
  return bits;
}

// Corners of faces that are equal in place and colour become one vertex.
class Surface {
 public:
  Surface(const DrawnResult& drawn, const JobContext* job)
      : drawn_(drawn),
        job_(job),
        coloured_(drawn.colours.has_colours()),
        vertices_(MemoryOf(job), sizeof(Position) + (coloured_ ? sizeof(Colour) : 0), "a surface:"),
        table_(MemoryOf(job), TableEntryBytes(sizeof(Key) + sizeof(uint64_t)), "the corners of a surface:") {}

  // All exposed faces. RESOURCE_EXHAUSTED as soon as the file would have more bytes than its header can count.
  absl::Status AddFaces() {
    const absl::StatusOr<FaceCount> count = CountFaces(drawn_.volume, job_);
    if (!count.ok()) return count.status();
    if (absl::Status s = ReserveFaces(count->faces); !s.ok()) return s;
    const int64_t layers = drawn_.volume.dims()[2];
    JobPoll poll(job_);
    for (int64_t layer = 0; layer < drawn_.volume.layers(); ++layer) {
      const int64_t k = drawn_.volume.Layer(layer);
      ForgetBelow(k);
      const absl::Status s = VisitFaces(drawn_.volume, k, poll, [&](int64_t i, int64_t j, uint64_t n, int side) {
        if (!status_.ok()) return;
        AddRectangle({i, j, k}, {i, j, k}, side, ColourAt(n));
        if (bytes() <= kMaxFileBytes || !status_.ok()) return;
        status_ = absl::ResourceExhaustedError(
            absl::StrCat(".glb counts bytes in 32 bits: in layer ", k + 1, " of ", layers, " the surface has ", bytes(),
                         ", more than ", kMaxFileBytes, "; a lower resolution fits, or .ply, .npz and .nvdb"));
      });
      if (!s.ok()) return s;
      if (!status_.ok()) return status_;
    }
    return absl::OkStatus();
  }

  // The same faces, merged.
  absl::Status AddMergedFaces() {
    MemoryCharge list(&MemoryOf(job_));
    const auto colour_of = [&](uint64_t n) { return BitsOf(ColourAt(n)); };
    const absl::StatusOr<std::vector<MergedFace>> faces = MergeFaces(drawn_.volume, colour_of, job_, list);
    if (!faces.ok()) return faces.status();
    if (absl::Status s = ReserveFaces(faces->size()); !s.ok()) return s;
    JobPoll poll(job_);
    for (const MergedFace& face : *faces) {
      Colour colour;
      std::memcpy(colour.data(), &face.colour, sizeof colour);
      AddRectangle(face.low, face.high, face.side, colour);
      if (!status_.ok()) return status_;
      if (absl::Status s = poll.Add(1); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  uint64_t bytes() const {
    return positions.size() * sizeof(Position) + colours.size() * sizeof(Colour) + indices.size() * sizeof(uint32_t);
  }

  using Position = std::array<float, 3>;
  std::vector<Position> positions;
  std::vector<Colour> colours;  // empty if all voxels have one
  std::vector<uint32_t> indices;
  std::array<float, 3> low, high;

 private:
  // x and y of the corner, 32 bits each, and the bits of the colour.
  using Key = std::pair<uint64_t, uint64_t>;

  Colour ColourAt(uint64_t n) const { return coloured_ ? ColourOf(drawn_.colours.At(n)) : Colour{}; }

  absl::Status ReserveFaces(uint64_t faces) {
    constexpr uint64_t kFaceIndices = 6;
    const uint64_t most = kMaxFileBytes / sizeof(uint32_t) + kFaceIndices;
    const uint64_t count = std::min(faces * kFaceIndices, most);
    if (absl::Status s = drawn_.memory.Grow(count, sizeof(uint32_t), "a surface:"); !s.ok()) return s;
    indices.reserve(count);
    return absl::OkStatus();
  }

  // No later layer has corners below z.
  void ForgetBelow(int64_t z) {
    absl::erase_if(corners_, [&](const auto& entry) {
      if (entry.first >= z) return false;
      table_entries_ -= entry.second.size();
      return true;
    });
  }

  // A side of the voxels from `first` to `last`, both included.
  void AddRectangle(const std::array<int64_t, 3>& first, const std::array<int64_t, 3>& last, int side,
                    const Colour& colour) {
    // Memory for four more vertices.
    status_ = vertices_.Reach(positions.size() + 4, positions);
    if (status_.ok()) status_ = table_.Reach(table_entries_ + 4);
    if (!status_.ok()) return;
    if (coloured_) colours.reserve(positions.capacity());
    const uint64_t bits = BitsOf(colour);
    std::array<uint32_t, 4> face;
    for (size_t c = 0; c < 4; ++c) {
      std::array<int64_t, 3> corner;
      for (size_t a = 0; a < 3; ++a) corner[a] = kSideCorners[size_t(side)][c][a] == 0 ? first[a] : last[a] + 1;
      const Key key{uint64_t(corner[0]) << 32 | uint64_t(corner[1]), bits};
      const auto [entry, added] = corners_[corner[2]].try_emplace(key, uint32_t(positions.size()));
      if (added) AddVertex(corner, colour);
      face[c] = entry->second;
    }
    for (const size_t c : {0, 1, 2, 0, 2, 3}) indices.push_back(face[c]);
  }

  void AddVertex(const std::array<int64_t, 3>& corner, const Colour& colour) {
    const Position position{float(corner[0]), float(corner[1]), float(corner[2])};
    for (size_t a = 0; a < 3; ++a) {
      low[a] = positions.empty() ? position[a] : std::min(low[a], position[a]);
      high[a] = positions.empty() ? position[a] : std::max(high[a], position[a]);
    }
    ++table_entries_;
    positions.push_back(position);
    if (coloured_) colours.push_back(colour);
  }

  const DrawnResult& drawn_;
  const JobContext* job_;
  bool coloured_;
  absl::Status status_;
  ChargedGrowth vertices_, table_;
  uint64_t table_entries_ = 0;
  absl::flat_hash_map<int64_t, absl::flat_hash_map<Key, uint32_t>> corners_;  // vertices by z
};

ordered_json SceneOf(const GridSpec& grid, const Surface& surface) {
  const Vec3d &o = grid.origin, &h = grid.voxel_size;
  ordered_json node = {{"name", "voxels"}, {"translation", {o.x, o.y, o.z}}, {"scale", {h.x, h.y, h.z}}};
  node["extras"] = {{"dims", grid.dims}, {"origin", {o.x, o.y, o.z}}, {"voxel_size", {h.x, h.y, h.z}}};
  ordered_json json = {
      {"asset", {{"version", "2.0"}, {"generator", "voxelpipe"}}}, {"scene", 0}, {"scenes", {{{"nodes", {0}}}}}};
  if (surface.indices.empty()) {
    json["nodes"] = ordered_json::array({node});
    return json;
  }
  node["mesh"] = 0;
  json["nodes"] = ordered_json::array({node});
  ordered_json attributes = {{"POSITION", 0}};
  ordered_json views = ordered_json::array(), accessors = ordered_json::array();
  uint64_t at = 0;
  const auto add = [&](uint64_t bytes, int target, const ordered_json& accessor) {
    views.push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", bytes}, {"target", target}});
    ordered_json own = {{"bufferView", views.size() - 1}};
    own.update(accessor);
    accessors.push_back(own);
    at += bytes;
  };
  add(surface.positions.size() * sizeof(Surface::Position), kArrayBuffer,
      {{"componentType", kFloat},
       {"count", surface.positions.size()},
       {"type", "VEC3"},
       {"min", surface.low},
       {"max", surface.high}});
  if (!surface.colours.empty()) {
    attributes["COLOR_0"] = 1;
    add(surface.colours.size() * sizeof(Colour), kArrayBuffer,
        {{"componentType", kUnsignedShort}, {"normalized", true}, {"count", surface.colours.size()}, {"type", "VEC4"}});
  }
  add(surface.indices.size() * sizeof(uint32_t), kElementArrayBuffer,
      {{"componentType", kUnsignedInt}, {"count", surface.indices.size()}, {"type", "SCALAR"}});
  json["meshes"] = ordered_json::array(
      {{{"primitives",
         ordered_json::array({{{"attributes", attributes}, {"indices", accessors.size() - 1}, {"material", 0}}})}}});
  json["materials"] =
      ordered_json::array({{{"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}}}});
  json["accessors"] = accessors;
  json["bufferViews"] = views;
  json["buffers"] = ordered_json::array({{{"byteLength", at}}});
  return json;
}

template <typename T>
std::span<const uint8_t> AsBytes(const std::vector<T>& values) {
  return {reinterpret_cast<const uint8_t*>(values.data()), values.size() * sizeof(T)};
}

absl::Status WriteSurface(const DrawnResult& drawn, const Surface& surface, AtomicFile& file, const JobContext* job) {
  std::string json = SceneOf(drawn.result.grid, surface).dump();
  json.resize((json.size() + 3) / 4 * 4, ' ');
  constexpr uint64_t kHeadBytes = 12, kChunkBytes = 8;
  const uint64_t binary = surface.bytes();  // a multiple of 4
  const uint64_t whole = kHeadBytes + kChunkBytes + json.size() + (binary > 0 ? kChunkBytes + binary : 0);
  if (whole > kMaxFileBytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat(".glb counts bytes in 32 bits, and the file has ", whole, "; .ply, .npz and .nvdb hold it"));
  }
  Bytes head;
  head.Text("glTF").Put(uint32_t{2}).Put(uint32_t(whole)).Put(uint32_t(json.size())).Text("JSON").Text(json);
  if (binary > 0) head.Put(uint32_t(binary)).Text(std::string_view("BIN\0", 4));
  absl::Status s = file.Write(head.span(), job);
  if (s.ok()) s = file.Write(AsBytes(surface.positions), job);
  if (s.ok()) s = file.Write(AsBytes(surface.colours), job);
  if (s.ok()) s = file.Write(AsBytes(surface.indices), job);
  return s;
}

absl::Status EncodeGlb(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  Surface surface(drawn, job);
  if (absl::Status s = surface.AddFaces(); !s.ok()) return s;
  return WriteSurface(drawn, surface, file, job);
}

absl::Status EncodeMergedGlb(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  Surface surface(drawn, job);
  if (absl::Status s = surface.AddMergedFaces(); !s.ok()) return s;
  return WriteSurface(drawn, surface, file, job);
}

}  // namespace

std::unique_ptr<ResultFile> MakeGlbFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".glb", path, job, &EncodeGlb);
}

std::unique_ptr<ResultFile> MakeMergedGlbFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".merged.glb", path, job, &EncodeMergedGlb);
}

}  // namespace voxelpipe
