#include "load/stl/stl.h"

#include <bit>
#include <cstring>
#include <string_view>
#include <utility>

#include "base/text.h"
#include "load/base/flat_scene.h"
#include "load/base/load_budget.h"
#include "load/base/text_reader.h"

namespace voxelpipe {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr uint64_t kCountAt = 80, kFirstTriangleAt = 84, kTriangleBytes = 50;
constexpr uint64_t kNormalBytes = 12, kVertexBytes = 12, kAttributeAt = 48;
constexpr size_t kMaxNameBytes = 60;          // of a word in a warning
constexpr uint64_t kElementsAStep = 1 << 14;  // between two polls of the job

uint64_t DeclaredTriangles(std::span<const uint8_t> bytes) {
  uint32_t count = 0;
  std::memcpy(&count, bytes.data() + kCountAt, sizeof count);
  return count;
}

// A text, as far as its beginning shows: binary files have a zero byte in their header or count.
bool LooksLikeText(std::string_view text) {
  constexpr size_t kBytes = 1024;
  return text.substr(0, kBytes).find('\0') == std::string_view::npos;
}

absl::StatusOr<Primitive> ReadBinary(std::span<const uint8_t> bytes, LoadBudget& budget, WarningList& warnings) {
  if (bytes.size() < kFirstTriangleAt) {
    return budget.Invalid("a binary file begins with ", kFirstTriangleAt, " bytes of header, the file has ",
                          bytes.size(), " bytes; an ASCII file begins with 'solid'");
  }
  const uint64_t count = DeclaredTriangles(bytes), need = kFirstTriangleAt + count * kTriangleBytes;
  if (need > bytes.size()) {
    return budget.Invalid("byte ", kCountAt, ": ", count, " triangles take ", need, " bytes, the file has ",
                          bytes.size(), "; it may be cut off");
  }
  if (absl::Status full = budget.CheckTriangles(count); !full.ok()) return full;
  if (absl::Status full = budget.CheckVertices(3 * count); !full.ok()) return full;
  if (need < bytes.size()) {
    warnings.Add(WarningCode::kNonconformingFile, "",
                 absl::StrCat(bytes.size() - need, " bytes after the last triangle are ignored"));
  }
  Primitive out;
  if (absl::Status full = budget.MakeRoom(out.positions, 3 * count, "vertices"); !full.ok()) return full;
  if (absl::Status full = budget.MakeRoom(out.triangles, count, "triangles"); !full.ok()) return full;
  uint32_t attributes = 0;
  for (uint64_t i = 0; i < count; ++i) {
    if (i % kElementsAStep == 0) {
      if (absl::Status over = budget.job().Check(); !over.ok()) return over;
    }
    const uint8_t* const triangle = bytes.data() + kFirstTriangleAt + i * kTriangleBytes;
    Vec3f corners[3];
    std::memcpy(corners, triangle + kNormalBytes, sizeof corners);
    static_assert(sizeof corners == 3 * kVertexBytes);
    for (int c = 0; c < 3; ++c) {
      if (!IsFinite(corners[c])) return budget.Invalid("triangle ", i, ", vertex ", c, " is not finite");
      out.positions.push_back(corners[c]);
    }
    uint16_t attribute = 0;
    std::memcpy(&attribute, triangle + kAttributeAt, sizeof attribute);
    attributes |= attribute;
    const auto first = static_cast<uint32_t>(3 * i);
    out.triangles.push_back({first, first + 1, first + 2});
  }
  if (attributes != 0) {
    warnings.Add(WarningCode::kExtensionIgnored, "",
                 "attribute bytes of the triangles, in which some programs write colours, are ignored");
  }
  return out;
}

// The statements of an ASCII file, one or more a line.
class AsciiReader {
 public:
  AsciiReader(std::string_view text, LoadBudget& budget, WarningList& warnings)
      : lines_(text, budget.job()), budget_(budget), warnings_(warnings) {}

  absl::StatusOr<Primitive> Read() {
    while (const std::optional<std::string_view> line = lines_.Next()) {
      Words words(*line, &budget_.job());
      for (std::string_view word = words.Next(); !word.empty(); word = words.Next()) {
        if (SameWord(word, "solid") || SameWord(word, "endsolid")) {  // the rest is a name
          if (absl::Status bad = Solid(SameWord(word, "solid")); !bad.ok()) return bad;
          break;
        }
        if (SameWord(word, "end")) {  // "end solid", "end facet" and "end loop" of some programs
          const std::string_view what = words.Next();
          WarnOfSpace(what);
          if (SameWord(what, "solid")) {
            if (absl::Status bad = Solid(false); !bad.ok()) return bad;
            break;
          }
          if (SameWord(what, "loop")) continue;
          if (!SameWord(what, "facet")) return Bad("'end' ", Quote(what), " is no statement of an ASCII STL");
          if (absl::Status bad = EndFacet(); !bad.ok()) return bad;
          continue;
        }
        if (absl::Status bad = Statement(word, words); !bad.ok()) return bad;
      }
    }
    if (in_facet_) return budget_.Invalid("line ", facet_line_, ": the facet is cut off by the end of the file");
    if (in_solid_) {
      warnings_.Add(WarningCode::kNonconformingFile, absl::StrCat("line ", lines_.number()),
                    "the file ends without 'endsolid'; it may be cut off");
    }
    return std::move(out_);
  }

 private:
  template <typename... Parts>
  absl::Status Bad(const Parts&... what) const {
    return budget_.Invalid("line ", lines_.number(), ": ", what...);
  }

  void WarnOfSpace(std::string_view what) {
    if (std::exchange(warned_of_space_, true)) return;
    warnings_.Add(WarningCode::kNonconformingFile, absl::StrCat("line ", lines_.number()),
                  absl::StrCat("'end ", CleanText(what, kMaxNameBytes), "' is read as one word, here and below"));
  }

  absl::Status Solid(bool begins) {
    if (in_facet_) return Bad("a facet that began in line ", facet_line_, " has no 'endfacet'");
    in_solid_ = begins;
    return absl::OkStatus();
  }

  absl::Status Statement(std::string_view word, Words& words) {
    if (SameWord(word, "vertex")) return Vertex(words);
    if (SameWord(word, "facet")) {
      if (in_facet_) return Bad("a facet inside that of line ", facet_line_);
      in_facet_ = true;
      facet_line_ = lines_.number();
      corners_ = 0;
      if (!SameWord(words.Next(), "normal")) return Bad("'normal' must follow 'facet'");
      for (int axis = 0; axis < 3; ++axis) {
        if (words.Next().empty()) return Bad("a normal has three numbers");
      }
      return absl::OkStatus();
    }
    if (SameWord(word, "outer")) {
      return SameWord(words.Next(), "loop") ? absl::OkStatus() : Bad("'loop' must follow 'outer'");
    }
    if (SameWord(word, "endloop")) return absl::OkStatus();
    if (SameWord(word, "endfacet")) return EndFacet();
    return Bad(Quote(word), " is no statement of an ASCII STL (solid, facet, outer loop, vertex, endloop, endfacet, ",
               "endsolid)");
  }

  absl::Status Vertex(Words& words) {
    if (!in_facet_) return Bad("a vertex outside a facet");
    if (corners_ == 3) return Bad("a fourth vertex of the facet; facets are triangles");
    Vec3f p;
    for (int axis = 0; axis < 3; ++axis) {
      const std::string_view word = words.Next();
      if (word.empty()) return Bad("a vertex has three numbers");
      if (!ReadReal(word, p[axis])) return Bad(Quote(word), " is no number");
    }
    if (!IsFinite(p)) return Bad("the vertex is not finite");
    corner_[corners_++] = p;
    return absl::OkStatus();
  }

  absl::Status EndFacet() {
    if (!in_facet_) return Bad("'endfacet' without 'facet'");
    if (corners_ != 3) return Bad("a facet of ", corners_, " vertices; facets are triangles");
    in_facet_ = false;
    const uint64_t count = out_.triangles.size() + 1;
    if (absl::Status full = budget_.CheckTriangles(count); !full.ok()) return full;
    if (absl::Status full = budget_.CheckVertices(3 * count); !full.ok()) return full;
    if (absl::Status full = budget_.MakeRoom(out_.positions, 3, "vertices"); !full.ok()) return full;
    if (absl::Status full = budget_.MakeRoom(out_.triangles, 1, "triangles"); !full.ok()) return full;
    const auto first = static_cast<uint32_t>(out_.positions.size());
    for (const Vec3f& p : corner_) out_.positions.push_back(p);
    out_.triangles.push_back({first, first + 1, first + 2});
    return absl::OkStatus();
  }

  TextLines lines_;
  LoadBudget& budget_;
  WarningList& warnings_;
  Primitive out_;
  bool in_solid_ = false, in_facet_ = false, warned_of_space_ = false;
  uint64_t facet_line_ = 0;
  int corners_ = 0;
  Vec3f corner_[3];
};

}  // namespace

bool IsBinaryStl(std::span<const uint8_t> beginning, uint64_t file_bytes) {
  return beginning.size() >= kFirstTriangleAt &&
         kFirstTriangleAt + DeclaredTriangles(beginning) * kTriangleBytes == file_bytes;
}

absl::StatusOr<Scene> LoadStl(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  LoadBudget budget(job, limits, "STL");
  WarningList warnings;
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const bool binary = IsBinaryStl(bytes, bytes.size()) || !LooksLikeText(text);
  absl::StatusOr<Primitive> primitive =
      binary ? ReadBinary(bytes, budget, warnings) : AsciiReader(text, budget, warnings).Read();
  if (!primitive.ok()) return primitive.status();
  std::vector<Primitive> primitives;
  primitives.push_back(*std::move(primitive));
  return OneMeshScene(std::move(primitives), std::move(warnings), budget);
}

}  // namespace voxelpipe
