#include "load/off/off.h"

#include <optional>
#include <string_view>
#include <utility>

#include "load/base/flat_scene.h"
#include "load/base/load_budget.h"
#include "load/base/text_reader.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMinVertexBytes = 6, kMinFaceBytes = 2;  // "0 0 0" and "0" with the end of the line

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
  Lines(std::string_view text, const JobContext& job) : lines_(text, job), job_(job) {}

  std::optional<std::string_view> Next() {
    while (std::optional<std::string_view> line = lines_.Next()) {
      line = line->substr(0, line->find('#'));
      if (!Words(*line, &job_).Next().empty()) return line;
    }
    return std::nullopt;
  }
  uint64_t number() const { return lines_.number(); }
  size_t at() const { return lines_.at(); }

 private:
  TextLines lines_;
  const JobContext& job_;
};

class OffReader {
 public:
  OffReader(std::string_view text, LoadBudget& budget, WarningList& warnings)
      : lines_(text, budget.job()), bytes_(text.size()), budget_(budget), warnings_(warnings) {}

  absl::StatusOr<Primitive> Read() {
    if (absl::Status bad = ReadHead(); !bad.ok()) return bad;
    if (absl::Status bad = ReadVertices(); !bad.ok()) return bad;
    if (absl::Status bad = ReadFaces(); !bad.ok()) return bad;
    if (lines_.Next()) {
      warnings_.Add(WarningCode::kCountMismatch, absl::StrCat("line ", lines_.number()),
                    "lines after the last face are ignored");
    }
    return std::move(out_);
  }

 private:
  template <typename... Parts>
  absl::Status Bad(const Parts&... what) const {
    return budget_.Invalid("line ", lines_.number() == 0 ? 1 : lines_.number(), ": ", what...);
  }

  Words WordsOf(std::string_view line) const { return Words(line, &budget_.job()); }

  absl::Status ReadHead() {
    std::optional<std::string_view> line = lines_.Next();
    if (!line) return Bad("the file has no lines but comments");
    Words words = WordsOf(*line);
    std::string_view word = words.Next(), glued;
    if (const std::optional<Kind> kind = KindOf(word, glued)) {
      kind_ = *kind;
      if (kind->other_dimension) return Bad(Quote(word), ": only vertices of three dimensions are read");
      word = glued.empty() ? words.Next() : glued;
      if (word == "BINARY") return Bad("binary OFF is not read; save the mesh as text");
      if (word.empty()) {
        line = lines_.Next();
        if (!line) return Bad("the counts of vertices and faces are missing; the file may be cut off");
        words = WordsOf(*line);
        word = words.Next();
      }
    }
    int64_t vertices = 0, faces = 0;
    const std::string_view second = words.Next();
    if (!ReadInteger(word, vertices) || !ReadInteger(second, faces) || vertices < 0 || faces < 0) {
      return Bad("the counts of vertices and faces are expected, not ", Quote(word), " ", Quote(second));
    }
    vertices_ = uint64_t(vertices);
    faces_ = uint64_t(faces);
    const uint64_t left = bytes_ - std::min<uint64_t>(lines_.at(), bytes_) + 1;  // the last line may have no end
    if (vertices_ > left / kMinVertexBytes || faces_ > left / kMinFaceBytes) {
      return Bad(vertices_, " vertices and ", faces_, " faces do not fit into the rest of the file; it may be cut off");
    }
    return budget_.CheckVertices(vertices_);
  }

  // Words of the line as numbers. False at the first that is none; it is then `word_`.
  bool Take(Words& words, float* values, int count) {
    for (int i = 0; i < count; ++i) {
      word_ = words.Next();
      if (!ReadFloat(word_, values[i])) return false;
    }
    return true;
  }
  absl::Status NoNumber(const char* what) const {
    if (word_.empty()) return Bad(what, " is incomplete");
    return Bad(what, ": ", Quote(word_), " is no number");
  }

  absl::Status ReadVertices() {
    absl::Status full = budget_.MakeRoom(out_.positions, vertices_, "vertices");
    if (full.ok() && kind_.normal) full = budget_.MakeRoom(out_.normals, vertices_, "normals");
    if (full.ok() && kind_.color) full = budget_.MakeRoom(out_.colors, vertices_, "colours");
    if (full.ok() && kind_.uv) full = budget_.MakeRoom(out_.uv[0], vertices_, "texture coordinates");
    if (!full.ok()) return full;
    for (uint64_t i = 0; i < vertices_; ++i) {
      const std::optional<std::string_view> line = lines_.Next();
      if (!line) return Bad("the file ends behind ", i, " of ", vertices_, " vertices");
      if (absl::Status bad = ReadVertex(WordsOf(*line)); !bad.ok()) return bad;
    }
    const auto warn = [&](const char* what) {
      warnings_.Add(WarningCode::kNonconformingFile, "vertices",
                    absl::StrCat(what, " have values that are not finite; they count as 0"));
    };
    if (CleanNormals(budget_.job(), out_.normals)) warn("normals");
    if (CleanUv(budget_.job(), out_.uv[0])) warn("texture coordinates");
    return absl::OkStatus();
  }

  absl::Status ReadVertex(Words words) {
    float p[3], n[3], uv[2];
    if (!Take(words, p, 3)) return NoNumber("a vertex");
    if (!IsFinite({p[0], p[1], p[2]})) return Bad("the vertex is not finite");
    out_.positions.push_back({p[0], p[1], p[2]});
    if (kind_.normal) {
      if (!Take(words, n, 3)) return NoNumber("a normal");
      out_.normals.push_back({n[0], n[1], n[2]});
    }
    if (kind_.color) {
      if (absl::Status bad = ReadColor(words); !bad.ok()) return bad;
    }
    if (kind_.uv) {
      if (!Take(words, uv, 2)) return NoNumber("a texture coordinate");
      out_.uv[0].push_back({uv[0], 1 - uv[1]});
    }
    if (!words.Next().empty() && !std::exchange(warned_of_values_, true)) {
      warnings_.Add(WarningCode::kNonconformingFile, absl::StrCat("line ", lines_.number()),
                    "a vertex with more numbers than the keyword says; they are ignored here and below");
    }
    return absl::OkStatus();
  }

  // Three or four numbers: as many as there are before the texture coordinate.
  absl::Status ReadColor(Words& words) {
    Words ahead = words;
    int left = 0;
    while (left < 7 && !ahead.Next().empty()) ++left;
    const int count = left - (kind_.uv ? 2 : 0) >= 4 ? 4 : 3;
    float c[4] = {0, 0, 0, 1};
    bool fraction = false;
    for (int i = 0; i < count; ++i) {
      word_ = words.Next();
      if (!ReadFloat(word_, c[i])) return NoNumber("a colour");
      fraction = fraction || word_.find_first_of(".eE") != std::string_view::npos;
    }
    const float most = fraction ? 1.0f : 255.0f;
    out_.colors.push_back(LinearColor({c[0] / most, c[1] / most, c[2] / most, count == 4 ? c[3] / most : 1.0f}));
    return absl::OkStatus();
  }

  absl::Status ReadFaces() {
    std::vector<uint32_t> corners;
    uint64_t few = 0;
    bool colors = false;
    for (uint64_t i = 0; i < faces_; ++i) {
      const std::optional<std::string_view> line = lines_.Next();
      if (!line) return Bad("the file ends behind ", i, " of ", faces_, " faces");
      Words words = WordsOf(*line);
      const std::string_view first = words.Next();
      int64_t count = 0;
      if (!ReadInteger(first, count) || count < 0) return Bad("the number of corners of a face, not ", Quote(first));
      if (uint64_t(count) > line->size() / 2) return Bad("the line is too short for a face of ", count, " corners");
      corners.clear();
      if (absl::Status full = budget_.MakeRoom(corners, uint64_t(count), "a face"); !full.ok()) return full;
      for (int64_t c = 0; c < count; ++c) {
        const std::string_view word = words.Next();
        int64_t index = 0;
        if (!ReadInteger(word, index)) return Bad("corner ", c, " of the face: ", Quote(word), " is no index");
        if (index < 0 || uint64_t(index) >= vertices_) {
          return Bad("vertex ", index, " does not exist: there are ", vertices_);
        }
        corners.push_back(uint32_t(index));
      }
      if (count < 3) ++few;
      colors = colors || !words.Next().empty();
      if (absl::Status bad = AddFan(corners, budget_, out_.triangles); !bad.ok()) return bad;
    }
    if (few > 0) {
      warnings_.Add(WarningCode::kNonconformingFile, "faces",
                    absl::StrCat(few, " faces of fewer than three corners are ignored"));
    }
    if (colors) warnings_.Add(WarningCode::kExtensionIgnored, "faces", "colours of faces are ignored");
    out_.points_or_lines = faces_ == few;
    return absl::OkStatus();
  }

  Lines lines_;
  const uint64_t bytes_;
  LoadBudget& budget_;
  WarningList& warnings_;
  Primitive out_;
  Kind kind_;
  uint64_t vertices_ = 0, faces_ = 0;
  std::string_view word_;
  bool warned_of_values_ = false;
};

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
  absl::StatusOr<Primitive> primitive = OffReader(TextOf(bytes), budget, warnings).Read();
  if (!primitive.ok()) return primitive.status();
  std::vector<Primitive> primitives;
  primitives.push_back(*std::move(primitive));
  return OneMeshScene(std::move(primitives), std::move(warnings), budget);
}

}  // namespace voxelpipe
