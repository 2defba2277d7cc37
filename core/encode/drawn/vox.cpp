// MagicaVoxel's scenes, version 200: models of at most 256 voxels a side, placed by a scene graph.
//
// Sources: ephtracy, "MagicaVoxel .vox File Format" and "... Extension", 2016 to 2022. A transform places the centre of
// a model, floor(size / 2). z points up, so that (x, y, z) of the grid is (x, nz - 1 - z, y) there.
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

std::string SceneGraph(const std::vector<Model>& models) {
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
    for (size_t a = 0; a < 3; ++a) centre[a] = models[m].first[a] + models[m].size[a] / 2;
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

absl::StatusOr<Palette> PaletteOf(const DrawnResult& drawn, const JobContext* job) {
  absl::flat_hash_map<uint32_t, uint64_t> occurrences;
  const absl::Status visited = VisitVoxels(
      drawn.volume, job, [&](int64_t, int64_t, int64_t, uint64_t n) { ++occurrences[SrgbCodes(drawn.colours.At(n))]; });
  if (!visited.ok()) return visited;
  return MakePalette(occurrences, kPaletteSize);
}

// The models that have voxels, or one without any.
absl::StatusOr<std::vector<Model>> ModelsOf(const DrawnResult& drawn, const Palette& palette, const JobContext* job) {
  const auto& grid = drawn.volume.dims();
  const std::array<int64_t, 3> dims{grid[0], grid[2], grid[1]};
  std::array<int64_t, 3> count{};
  for (size_t a = 0; a < 3; ++a) count[a] = (dims[a] + kMaxSide - 1) / kMaxSide;
  std::vector<Model> models(size_t(count[0] * count[1] * count[2]));
  const absl::Status visited = VisitVoxels(drawn.volume, job, [&](int64_t i, int64_t j, int64_t k, uint64_t n) {
    const std::array<int64_t, 3> at{i, grid[2] - 1 - k, j};
    Model& model = models[size_t(at[0] / kMaxSide + count[0] * (at[1] / kMaxSide + count[1] * (at[2] / kMaxSide)))];
    for (const int64_t index : at) model.voxels += char(index % kMaxSide);
    model.voxels += char(palette.nearest.at(SrgbCodes(drawn.colours.At(n))) + 1);
  });
  if (!visited.ok()) return visited;
  for (size_t m = 0; m < models.size(); ++m) {
    const auto place = int64_t(m);
    const std::array<int64_t, 3> block{place % count[0], place / count[0] % count[1], place / count[0] / count[1]};
    for (size_t a = 0; a < 3; ++a) {
      models[m].first[a] = block[a] * kMaxSide;
      models[m].size[a] = std::min(kMaxSide, dims[a] - models[m].first[a]);
    }
  }
  const Model first = models[0];
  std::erase_if(models, [](const Model& model) { return model.voxels.empty(); });
  if (models.empty()) models.push_back(first);
  return models;
}

absl::Status EncodeVox(const DrawnResult& drawn, AtomicFile& file, const JobContext* job) {
  constexpr uint64_t kMaxBytes = std::numeric_limits<int32_t>::max();
  const uint64_t voxel_bytes = CountSolid(drawn.volume) * kEntryBytes;
  constexpr uint64_t kBesides = 64 << 20;  // more than the scene of the most models that fit
  const auto& dims = drawn.volume.dims();
  uint64_t blocks = 1;
  for (const int64_t dim : dims) blocks *= uint64_t((dim + kMaxSide - 1) / kMaxSide);
  constexpr uint64_t kMaxBlocks = 1 << 17;
  if (voxel_bytes > kMaxBytes - kBesides || blocks > kMaxBlocks) {
    return absl::InvalidArgumentError(absl::StrCat(".vox counts bytes in 32 bits: ", voxel_bytes / kEntryBytes,
                                                   " voxels in ", blocks,
                                                   " models are too many; .ply, .npz and .nvdb hold them"));
  }
  if (absl::Status s = drawn.memory.Grow(2 * voxel_bytes, "models:"); !s.ok()) return s;
  const absl::StatusOr<Palette> palette = PaletteOf(drawn, job);
  if (!palette.ok()) return palette.status();
  const absl::StatusOr<std::vector<Model>> models = ModelsOf(drawn, *palette, job);
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
  const std::string end = SceneGraph(*models) + Chunk("RGBA", colours);
  Bytes begin;
  begin.Text("VOX ").Put(int32_t{200}).Text("MAIN").Put(int32_t{0}).Put(int32_t(children + end.size()));
  absl::Status s = file.Write(begin.span(), job);
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
