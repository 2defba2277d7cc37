#include "load/off/off.h"

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "load/base/flat_scene.h"
#include "load/base/load_budget.h"
#include "load/base/polygons.h"
#include "load/base/text_reader.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMinVertexBytes = 6, kMinFaceBytes = 2;  // "0 0 0" and "0" with the end of the line
constexpr float kMaxFraction = 1.01f;                       // of a colour, as rounded as programs write it

// What the keyword says of a vertex.
struct Kind {
  bool uv = false, color = false, normal = false;
  bool other_dimension = false;  // "4" or "n": not three numbers a vertex
};

// The keyword at the beginning of a word; `rest` receives what follows it ("OFF8" of some files: 8 vertices).
std::optional<Kind> KindOf(std::string_view word, std::string_view& rest) {
  Kind kind;
  const auto skip = [&](std::string_view part) {
    if (word.substr(0, part.size()) != part) return false;
    word.remove_prefix(part.size());
    return true;
  };
  kind.uv = skip("ST");
  kind.color = skip("C");
  kind.normal = skip("N");
  kind.other_dimension = skip("4");
  kind.other_dimension = skip("n") || kind.other_dimension;
  if (!skip("OFF")) return std::nullopt;
  rest = word;
  if (!rest.empty() && (rest[0] < '0' || rest[0] > '9')) return std::nullopt;
  return kind;
}

// Lines without comments and blank ones.
class Lines {
 public:
  Lines(std::string_view text, const JobContext& job) : lines_(text, job), job_(&job) {}

  std::optional<std::string_view> Next() {
    while (std::optional<std::string_view> line = lines_.Next()) {
      line = line->substr(0, line->find('#'));
      if (!Words(*line, job_).Next().empty()) return line;
    }
    return std::nullopt;
  }
  uint64_t number() const { return lines_.number(); }
  const JobContext* job() const { return job_; }

 private:
  TextLines lines_;
  const JobContext* job_;
};

// The words of the lines, in order. A copy goes on from the same place.
class LineWords {
 public:
  explicit LineWords(const Lines& lines) : lines_(lines) {}

  // The next word of the line; empty at its end.
  std::string_view NextOnLine() { return words_.Next(); }
  // The next word of this line or a later one; empty at the end of the text.
  std::string_view Next() {
    std::string_view word = words_.Next();
    if (word.empty() && NextLine()) word = words_.Next();
    return word;
  }
  // Goes to the beginning of the next line; false at the end of the text.
  bool NextLine() {
    const std::optional<std::string_view> line = lines_.Next();
    words_ = Words(line.value_or(std::string_view()), lines_.job());
    return line.has_value();
  }
  // How many words are left on the line, at most `most`.
  int LeftOnLine(int most) const {
    Words ahead = words_;
    int left = 0;
    while (left < most && !ahead.Next().empty()) ++left;
    return left;
  }
  uint64_t number() const { return lines_.number() == 0 ? 1 : lines_.number(); }

 private:
  Lines lines_;
  Words words_{std::string_view()};
};

// What the head says.
struct Head {
  Kind kind;
  uint64_t vertices = 0, faces = 0;
};

template <typename... Parts>
absl::Status BadLine(const LoadBudget& budget, const LineWords& words, const Parts&... what) {
  return budget.Invalid("line ", words.number(), ": ", what...);
}

// In: the beginning of the text. Out: the head; `words` is behind it.
absl::StatusOr<Head> ReadHead(LineWords& words, uint64_t bytes, const LoadBudget& budget) {
  const auto bad = [&](const auto&... what) { return BadLine(budget, words, what...); };
  Head head;
  std::string_view word = words.Next(), glued;
  if (word.empty()) return bad("the file has no lines but comments");
  if (const std::optional<Kind> kind = KindOf(word, glued)) {
    head.kind = *kind;
    if (kind->other_dimension) return bad(Quote(word), ": only vertices of three dimensions are read");
    word = glued.empty() ? words.Next() : glued;
    if (word == "BINARY") return bad("binary OFF is not read; save the mesh as text");
    if (word.empty()) return bad("the counts of vertices and faces are missing; the file may be cut off");
  }
  int64_t vertices = 0, faces = 0;
  const std::string_view second = words.Next();
  if (!ReadInteger(word, vertices) || !ReadInteger(second, faces) || vertices < 0 || faces < 0) {
    return bad("the counts of vertices and faces are expected, not ", Quote(word), " ", Quote(second));
  }
  head.vertices = uint64_t(vertices);
  head.faces = uint64_t(faces);
  // The number of edges, which some files lack, has no use. On a line of its own it is no vertex.
  if (words.LeftOnLine(1) == 0) {
    LineWords ahead = words;
    int64_t edges = 0;
    if (ahead.NextLine() && ahead.LeftOnLine(2) == 1 && ReadInteger(ahead.Next(), edges)) words = ahead;
  } else {
    words.NextOnLine();
  }
  if (head.vertices > (bytes + 1) / kMinVertexBytes || head.faces > (bytes + 1) / kMinFaceBytes) {
    return bad(head.vertices, " vertices and ", head.faces, " faces do not fit into the file; it may be cut off");
  }
  if (absl::Status full = budget.CheckVertices(head.vertices); !full.ok()) return full;
  return head;
}

// The vertices and faces behind a head.
class BodyReader {
 public:
  // `a_line_each`: a vertex is a line, and what follows its numbers there is ignored. Otherwise the lines of vertices
  // have no meaning.
  BodyReader(const Head& head, const LineWords& words, uint64_t bytes, bool a_line_each, LoadBudget& budget)
      : head_(head), words_(words), bytes_(bytes), a_line_each_(a_line_each), budget_(budget), polygons_(budget) {}

  absl::StatusOr<Primitive> Read(WarningList& warnings) {
    if (absl::Status bad = ReadVertices(warnings); !bad.ok()) return bad;
    if (absl::Status bad = ReadFaces(warnings); !bad.ok()) return bad;
    if (words_.NextLine()) {
      warnings.Add(WarningCode::kCountMismatch, absl::StrCat("line ", words_.number()),
                   "lines after the last face are ignored");
    }
    return std::move(out_);
  }
  void Drop() {
    budget_.Drop(out_.positions);
    budget_.Drop(out_.double_positions);
    budget_.Drop(out_.normals);
    budget_.Drop(out_.colors);
    budget_.Drop(out_.uv[0]);
    budget_.Drop(out_.triangles);
  }

 private:
  template <typename... Parts>
  absl::Status Bad(const Parts&... what) const {
    return BadLine(budget_, words_, what...);
  }

  std::string_view NextOfVertex() { return word_ = a_line_each_ ? words_.NextOnLine() : words_.Next(); }

  // Numbers of a vertex. False at the first word that is none; it is then `word_`.
  template <typename Real>
  bool Take(Real* values, int count) {
    for (int i = 0; i < count; ++i) {
      if (!ReadReal(NextOfVertex(), values[i])) return false;
    }
    return true;
  }
  absl::Status NoNumber(const char* what) const {
    if (word_.empty()) return Bad(what, " is incomplete");
    return Bad(what, ": ", Quote(word_), " is no number");
  }

  absl::Status ReadVertices(WarningList& warnings) {
    const uint64_t count = head_.vertices;
    absl::Status full = budget_.MakeRoom(out_.positions, count, "vertices");
    if (full.ok() && head_.kind.normal) full = budget_.MakeRoom(out_.normals, count, "normals");
    if (full.ok() && head_.kind.color) full = budget_.MakeRoom(out_.colors, count, "colours");
    if (full.ok() && head_.kind.uv) full = budget_.MakeRoom(out_.uv[0], count, "texture coordinates");
    if (!full.ok()) return full;
    for (uint64_t i = 0; i < count; ++i) {
      if (a_line_each_ && !words_.NextLine()) {
        return Bad("the file ends behind ", i, " of ", count, " vertices");
      }
      if (absl::Status bad = ReadVertex(warnings); !bad.ok()) return bad;
    }
    if (absl::Status over = ConvertColors(); !over.ok()) return over;
    const auto warn = [&](const char* what) {
      warnings.Add(WarningCode::kNonconformingFile, "vertices",
                   absl::StrCat(what, " have values that are not finite; they count as 0"));
    };
    if (CleanNormals(budget_.job(), out_.normals)) warn("normals");
    if (CleanUv(budget_.job(), out_.uv[0])) warn("texture coordinates");
    return absl::OkStatus();
  }

  absl::Status ReadVertex(WarningList& warnings) {
    double p[3];
    float n[3], uv[2];
    if (!Take(p, 3)) return NoNumber("a vertex");
    const Vec3d position{p[0], p[1], p[2]};
    if (!IsFinite(ToFloat(position))) return Bad("the vertex is not finite");
    if (absl::Status full = AddPosition(position, budget_, out_); !full.ok()) return full;
    if (head_.kind.normal) {
      if (!Take(n, 3)) return NoNumber("a normal");
      out_.normals.push_back({n[0], n[1], n[2]});
    }
    if (head_.kind.color) {
      if (absl::Status bad = ReadColor(); !bad.ok()) return bad;
    }
    if (head_.kind.uv) {
      if (!Take(uv, 2)) return NoNumber("a texture coordinate");
      out_.uv[0].push_back({uv[0], 1 - uv[1]});
    }
    if (a_line_each_ && !words_.NextOnLine().empty() && !std::exchange(warned_of_values_, true)) {
      warnings.Add(WarningCode::kNonconformingFile, absl::StrCat("line ", words_.number()),
                   "a vertex with more numbers than the keyword says; they are ignored here and below");
    }
    return absl::OkStatus();
  }

  // As written, until ConvertColors. Of a line three or four numbers: as many as there are before the texture
  // coordinate.
  absl::Status ReadColor() {
    const bool has_alpha = !a_line_each_ || words_.LeftOnLine(7) - (head_.kind.uv ? 2 : 0) >= 4;
    Vec4f c{0, 0, 0, kOpaque};
    for (int i = 0; i < (has_alpha ? 4 : 3); ++i) {
      if (!ReadReal(NextOfVertex(), c[i])) return NoNumber("a colour");
      has_point_ = has_point_ || word_.find_first_of(".eE") != std::string_view::npos;
      most_ = std::max(most_, c[i]);
    }
    out_.colors.push_back(c);
    return absl::OkStatus();
  }

  absl::Status ConvertColors() {
    const float most = has_point_ && most_ <= kMaxFraction ? 1.0f : 255.0f;
    for (size_t i = 0; i < out_.colors.size(); ++i) {
      if (i % kColorsAStep == 0) {
        if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
      }
      Vec4f& c = out_.colors[i];
      c = LinearColor({c.x / most, c.y / most, c.z / most, c.w == kOpaque ? 1.0f : c.w / most});
    }
    return absl::OkStatus();
  }

  absl::Status ReadFaces(WarningList& warnings) {
    std::vector<uint32_t> corners;
    uint64_t few = 0;
    bool colors = false;
    for (uint64_t i = 0; i < head_.faces; ++i) {
      const std::string_view first = words_.Next();
      if (first.empty()) return Bad("the file ends behind ", i, " of ", head_.faces, " faces");
      int64_t count = 0;
      if (!ReadInteger(first, count) || count < 0) return Bad("the number of corners of a face, not ", Quote(first));
      if (uint64_t(count) > bytes_ / 2) {
        return Bad("a face of ", count, " corners does not fit into the file; it may be cut off");
      }
      corners.clear();
      if (absl::Status full = budget_.MakeRoom(corners, uint64_t(count), "a face"); !full.ok()) return full;
      for (int64_t c = 0; c < count; ++c) {
        const std::string_view word = words_.Next();
        int64_t index = 0;
        if (!ReadInteger(word, index)) return Bad("corner ", c, " of the face: ", Quote(word), " is no index");
        if (index < 0 || uint64_t(index) >= head_.vertices) {
          return Bad("vertex ", index, " does not exist: there are ", head_.vertices);
        }
        corners.push_back(uint32_t(index));
      }
      if (count < 3) ++few;
      // What follows the corners on their line is the face's colour.
      while (!words_.NextOnLine().empty()) colors = true;
      if (absl::Status bad = polygons_.Add(corners, out_); !bad.ok()) return bad;
    }
    budget_.Drop(corners);
    polygons_.Finish(warnings);
    if (few > 0) {
      warnings.Add(WarningCode::kNonconformingFile, "faces",
                   absl::StrCat(few, " faces of fewer than three corners are ignored"));
    }
    if (colors) warnings.Add(WarningCode::kExtensionIgnored, "faces", "colours of faces are ignored");
    out_.points_or_lines = head_.faces == few;
    return absl::OkStatus();
  }

  static constexpr float kOpaque = -1;             // no alpha in the file
  static constexpr size_t kColorsAStep = 1 << 16;  // between two polls of the job

  const Head head_;
  LineWords words_;
  const uint64_t bytes_;
  const bool a_line_each_;
  LoadBudget& budget_;
  Polygons polygons_;
  Primitive out_;
  std::string_view word_;
  bool warned_of_values_ = false;
  bool has_point_ = false;  // a number of a colour, or an exponent
  float most_ = 0;          // number of a colour
};

// Most files have a vertex a line, some with more numbers than the keyword says. Those that fit this in no way may
// break lines anywhere.
absl::StatusOr<Primitive> ReadOff(std::string_view text, LoadBudget& budget, WarningList& warnings) {
  LineWords words{Lines(text, budget.job())};
  const absl::StatusOr<Head> head = ReadHead(words, text.size(), budget);
  if (!head.ok()) return head.status();
  absl::Status first;
  for (const bool a_line_each : {true, false}) {
    BodyReader body(*head, words, text.size(), a_line_each, budget);
    WarningList found;
    absl::StatusOr<Primitive> read = body.Read(found);
    if (read.ok()) {
      warnings.Append(found);
      return read;
    }
    if (!absl::IsInvalidArgument(read.status())) return read.status();
    if (first.ok()) first = read.status();
    body.Drop();
  }
  return first;
}

std::string_view TextOf(std::span<const uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

bool IsOff(const JobContext& job, std::string_view text) {
  Lines lines(text, job);
  const std::optional<std::string_view> line = lines.Next();
  std::string_view rest;
  return line && KindOf(Words(*line, &job).Next(), rest).has_value();
}

absl::StatusOr<Scene> LoadOff(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  LoadBudget budget(job, limits, "OFF");
  WarningList warnings;
  absl::StatusOr<Primitive> primitive = ReadOff(TextOf(bytes), budget, warnings);
  if (!primitive.ok()) return primitive.status();
  std::vector<Primitive> primitives;
  primitives.push_back(*std::move(primitive));
  return OneMeshScene(std::move(primitives), std::move(warnings), budget);
}

}  // namespace voxelpipe
