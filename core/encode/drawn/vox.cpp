// MagicaVoxel's scenes, version 200: models of at most 256 voxels a side, placed by a scene graph.
//
// Sources: ephtracy, "MagicaVoxel .vox File Format" and "... Extension", 2016 to 2022. A transform places the centre of
// a model, floor(size / 2). z points up, so that (x, y, z) of the grid is (x, nz - 1 - z, y) there. Programs take
// voxels from -1000 to 999, so the grid's centre is at 0.
#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "absl/strings/str_cat.h"
#include "encode/drawn/palette.h"
#include "encode/drawn/whole_file.h"
#include "encode/formats/bytes.h"
#include "encode/formats/writers.h"

namespace voxelpipe {
namespace {

constexpr int64_t kMaxSide = 256;
constexpr size_t kPaletteSize = 255;  // index 0 is an empty voxel
constexpr size_t kEntryBytes = 4;     // of a voxel, and of a colour

struct Model {
  std::array<int64_t, 3> first, size;  // in the scene's axes
  std::string voxels;                  // x, y, z, colour index
};

using Text = std::pair<std::string, std::string>;

void PutText(Bytes& bytes, const std::string& text) {
  bytes.Put(int32_t(text.size())).Text(text);
}

void PutTexts(Bytes& bytes, const std::vector<Text>& texts) {
  bytes.Put(int32_t(texts.size()));
  for (const auto& [name, value] : texts) {
    PutText(bytes, name);
    PutText(bytes, value);
  }
}

std::string Chunk(std::string_view name, const Bytes& content) {
  return Bytes().Text(name).Put(int32_t(content.size())).Put(int32_t{0}).Text(content.text()).text();
}

// A transform of `child`, its centre at `centre`.
std::string Transform(int32_t id, int32_t child, const std::array<int64_t, 3>* centre) {
  Bytes node;
  node.Put(id);
  PutTexts(node, {});
  node.Put(child).Put(int32_t{-1}).Put(int32_t{-1}).Put(int32_t{1});  // reserved, no layer, one frame
  std::vector<Text> frame;
  if (centre != nullptr) frame = {{"_t", absl::StrCat((*centre)[0], " ", (*centre)[1], " ", (*centre)[2])}};
  PutTexts(node, frame);
  return Chunk("nTRN", node);
}

std::string SceneGraph(const std::vector<Model>& models, const std::array<int64_t, 3>& dims) {
  // 0: the root, 1: the group, then a transform and a shape for each model.
  std::string graph = Transform(0, 1, nullptr);
  Bytes group;
  group.Put(int32_t{1});
  PutTexts(group, {});
  group.Put(int32_t(models.size()));
  for (size_t m = 0; m < models.size(); ++m) group.Put(int32_t(2 + 2 * m));
  graph += Chunk("nGRP", group);
  for (size_t m = 0; m < models.size(); ++m) {
    std::array<int64_t, 3> centre{};
    for (size_t a = 0; a < 3; ++a) centre[a] = models[m].first[a] + models[m].size[a] / 2 - dims[a] / 2;
    graph += Transform(int32_t(2 + 2 * m), int32_t(3 + 2 * m), &centre);
    Bytes shape;
    shape.Put(int32_t(3 + 2 * m));
    PutTexts(shape, {});
    shape.Put(int32_t{1}).Put(int32_t(m));
    PutTexts(shape, {});
    graph += Chunk("nSHP", shape);
  }
  return graph;
}

// The models that a grid is divided into.
struct Blocks {
  std::array<int64_t, 3> dims, count;  // voxels and models, in the scene's axes

  explicit Blocks(const std::array<int64_t, 3>& grid) : dims{grid[0], grid[2], grid[1]} {
    for (size_t a = 0; a < 3; ++a) count[a] = (dims[a] + kMaxSide - 1) / kMaxSide;
  }
  uint64_t all() const { return uint64_t(count[0]) * uint64_t(count[1]) * uint64_t(count[2]); }
  // Of voxel (i, j, k) of the grid in the scene.
  std::array<int64_t, 3> PlaceOf(int64_t i, int64_t j, int64_t k) const { return {i, dims[1] - 1 - k, j}; }
  size_t BlockOf(const std::array<int64_t, 3>& at) const {
    return size_t(at[0] / kMaxSide + count[0] * (at[1] / kMaxSide + count[1] * (at[2] / kMaxSide)));
  }
};

// Also counts the voxels of each block.
absl::StatusOr<Palette> PaletteOf(const DrawnResult& drawn, const Blocks& blocks, const JobContext* job,
                                  std::vector<uint64_t>& voxels) {
  absl::flat_hash_map<uint32_t, uint64_t> occurrences;
  ChargedGrowth growth(MemoryOf(job), TableEntryBytes(2 * sizeof(uint64_t)), "a palette:");
  absl::Status full;
  const absl::Status visited = VisitVoxels(drawn.volume, job, [&](int64_t i, int64_t j, int64_t k, uint64_t n) {
    if (full.ok()) full = growth.Reach(occurrences.size() + 1, occurrences);
    if (!full.ok()) return;
    ++occurrences[SrgbCodes(drawn.colours.At(n))];
    ++voxels[blocks.BlockOf(blocks.PlaceOf(i, j, k))];
  });
  if (!visited.ok()) return visited;
  if (!full.ok()) return full;
  return MakePalette(occurrences, kPaletteSize, job);
}

// The models that have voxels, or one without any.
absl::StatusOr<std::vector<Model>> ModelsOf(const DrawnResult& drawn, const Blocks& blocks,
                                            const std::vector<uint64_t>& voxels, const Palette& palette,
                                            const JobContext* job) {
  std::vector<Model> models;
  std::vector<uint32_t> places(voxels.size());  // of blocks in `models`
  for (size_t m = 0; m < voxels.size(); ++m) {
    if (voxels[m] == 0 && (m > 0 || *std::max_element(voxels.begin(), voxels.end()) > 0)) continue;
    places[m] = uint32_t(models.size());
    const auto place = int64_t(m);
    const std::array<int64_t, 3> block{place % blocks.count[0], place / blocks.count[0] % blocks.count[1],
                                       place / blocks.count[0] / blocks.count[1]};
    Model& model = models.emplace_back();
    for (size_t a = 0; a < 3; ++a) {
      model.first[a] = block[a] * kMaxSide;
      model.size[a] = std::min(kMaxSide, blocks.dims[a] - model.first[a]);
    }
    model.voxels.reserve(voxels[m] * kEntryBytes);
  }
  const absl::Status visited = VisitVoxels(drawn.volume, job, [&](int64_t i, int64_t j, int64_t k, uint64_t n) {
    const std::array<int64_t, 3> at = blocks.PlaceOf(i, j, k);
    Model& model = models[places[blocks.BlockOf(at)]];
    for (const int64_t index : at) model.voxels += char(index % kMaxSide);
    model.voxels += char(palette.nearest.at(SrgbCodes(drawn.colours.At(n))) + 1);
  });
  if (!visited.ok()) return visited;
  return models;
}

absl::Status EncodeVox(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  constexpr uint64_t kMaxBytes = std::numeric_limits<int32_t>::max();
  const absl::StatusOr<uint64_t> solid = CountSolid(drawn.volume, job);
  if (!solid.ok()) return solid.status();
  const uint64_t voxel_bytes = *solid * kEntryBytes;
  constexpr uint64_t kBesides = 64 << 20;  // more than the scene of the most models that fit
  const Blocks blocks(drawn.volume.dims());
  constexpr uint64_t kMaxBlocks = 1 << 17;
  if (voxel_bytes > kMaxBytes - kBesides || blocks.all() > kMaxBlocks) {
    return absl::InvalidArgumentError(absl::StrCat(".vox counts bytes in 32 bits: ", voxel_bytes / kEntryBytes,
                                                   " voxels in ", blocks.all(),
                                                   " models are too many; .ply, .npz and .nvdb hold them"));
  }
  constexpr uint64_t kBlockBytes = sizeof(uint64_t) + sizeof(uint32_t);
  if (absl::Status s = drawn.memory.Grow(blocks.all(), kBlockBytes, "models:"); !s.ok()) return s;
  std::vector<uint64_t> voxels(blocks.all());
  const absl::StatusOr<Palette> palette = PaletteOf(drawn, blocks, job, voxels);
  if (!palette.ok()) return palette.status();
  constexpr uint64_t kModelBytes = 1024;  // its place in the scene as well
  const auto models_with_voxels =
      uint64_t(std::count_if(voxels.begin(), voxels.end(), [](uint64_t count) { return count > 0; }));
  absl::Status s = drawn.memory.Grow(voxel_bytes + kModelBytes * (models_with_voxels + 1), "models:");
  if (!s.ok()) return s;
  const absl::StatusOr<std::vector<Model>> models = ModelsOf(drawn, blocks, voxels, *palette, job);
  if (!models.ok()) return models.status();
  std::vector<std::string> heads;
  uint64_t children = 0;
  for (const Model& model : *models) {
    Bytes size, head;
    for (const int64_t side : model.size) size.Put(int32_t(side));
    head.Text(Chunk("SIZE", size));
    head.Text("XYZI").Put(int32_t(model.voxels.size() + 4)).Put(int32_t{0});
    head.Put(int32_t(model.voxels.size() / kEntryBytes));
    heads.push_back(head.text());
    children += head.size() + model.voxels.size();
  }
  Bytes colours;  // entry n is that of colour index n + 1
  for (size_t c = 0; c < kPaletteSize + 1; ++c) {
    const uint32_t rgb = c < palette->colours.size() ? palette->colours[c] : 0;
    colours.Put(uint8_t(rgb >> 16)).Put(uint8_t(rgb >> 8)).Put(uint8_t(rgb)).Put(uint8_t{255});
  }
  const std::string end = SceneGraph(*models, blocks.dims) + Chunk("RGBA", colours);
  Bytes begin;
  begin.Text("VOX ").Put(int32_t{200}).Text("MAIN").Put(int32_t{0}).Put(int32_t(children + end.size()));
  s = file.Write(begin.span(), job);
  for (size_t m = 0; m < models->size() && s.ok(); ++m) {
    s = file.Write(BytesOf(heads[m]), job);
    if (s.ok()) s = file.Write(BytesOf((*models)[m].voxels), job);
  }
  return s.ok() ? file.Write(BytesOf(end), job) : s;
}

}  // namespace

std::unique_ptr<ResultFile> MakeVoxFile(const std::string& path, const JobContext* job) {
  return MakeWholeFile(".vox", path, job, &EncodeVox);
}

}  // namespace voxelpipe
