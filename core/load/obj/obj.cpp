#include "load/obj/obj.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <string_view>
#include <utility>

#include "load/base/corner_mesh.h"
#include "load/base/flat_scene.h"
#include "load/base/load_budget.h"
#include "load/base/text_reader.h"
#include "load/obj/materials.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMaterialsAStep = 1 << 12;  // between two polls of the job

constexpr std::string_view kSilent[] = {"g", "o", "s", "mg", "lod", "bevel", "c_interp", "d_interp"};
constexpr std::string_view kFreeForm[] = {"vp",    "cstype", "deg",  "bmat",   "step",   "curv",       "curv2",
                                          "surf",  "parm",   "trim", "hole",   "scrv",   "sp",         "end",
                                          "con",   "bzp",    "bsp",  "cdc",    "cdp",    "res",        "ctech",
                                          "stech", "call",   "csh",  "usemap", "maplib", "shadow_obj", "trace_obj"};
constexpr std::string_view kRead[] = {"v", "vt", "vn", "f", "fo", "p", "l", "usemtl", "mtllib"};

template <size_t N>
bool IsOneOf(std::string_view word, const std::string_view (&words)[N]) {
  return std::find(std::begin(words), std::end(words), word) != std::end(words);
}

// The next number of a statement; empty at its end or at a comment.
std::string_view NextNumber(Words& words) {
  const std::string_view word = words.Next();
  return !word.empty() && word[0] == '#' ? std::string_view() : word;
}

class ObjReader {
 public:
  ObjReader(std::string_view text, LoadBudget& budget)
      : lines_(text, budget.job()),
        budget_(budget),
        materials_(scene_, budget),
        mesh_({&positions_, &uv_, &normals_, &colors_}, budget) {}

  absl::StatusOr<Scene> Read() {
    while (true) {
      const absl::StatusOr<std::optional<std::string_view>> line = NextLine();
      if (!line.ok()) return line.status();
      if (!*line) break;
      Words words(**line, &budget_.job());
      const std::string_view word = words.Next();
      if (word.empty() || word[0] == '#') continue;
      if (absl::Status bad = Statement(word, words); !bad.ok()) return bad;
    }
    if (!any_known_) return budget_.Invalid("no line is a statement of OBJ (v, f, ...)");
    return Finish();
  }

 private:
  template <typename... Parts>
  absl::Status Bad(const Parts&... what) const {
    return budget_.Invalid("line ", first_line_, ": ", what...);
  }
  void Warn(WarningCode code, const std::string& what) {
    scene_.warnings.Add(code, absl::StrCat("line ", first_line_), what);
  }

  // A line with those that it continues in ("\" at its end).
  absl::StatusOr<std::optional<std::string_view>> NextLine() {
    std::optional<std::string_view> line = lines_.Next();
    first_line_ = lines_.number();
    if (!line || line->empty() || line->back() != '\\') return line;
    joined_.clear();
    while (line) {
      const bool more = !line->empty() && line->back() == '\\';
      if (more) line->remove_suffix(1);
      if (absl::Status full = budget_.MakeRoom(joined_, line->size() + 1, "a line"); !full.ok()) return full;
      joined_.insert(joined_.end(), line->begin(), line->end());
      joined_.push_back(' ');
      if (!more) break;
      line = lines_.Next();
    }
    return std::string_view(joined_.data(), joined_.size());
  }

  absl::Status Statement(std::string_view word, Words& words) {
    if (word == "v") return Vertex(words);
    if (word == "f" || word == "fo") return Face(words);
    if (word == "vt") return TexCoord(words);
    if (word == "vn") return Normal(words);
    if (word == "usemtl") {
      any_known_ = true;
      const absl::StatusOr<int32_t> material = materials_.Find(words.Rest());
      if (!material.ok()) return material.status();
      material_ = *material;
      if (const size_t known = used_at_.size(); size_t(material_) >= known) {
        const uint64_t more = uint64_t(material_) + 1 - known;
        if (absl::Status full = budget_.MakeRoom(used_at_, more, "materials"); !full.ok()) return full;
        used_at_.resize(known + more);
      }
      if (used_at_[size_t(material_)] == 0) used_at_[size_t(material_)] = first_line_;
      return absl::OkStatus();
    }
    if (word == "mtllib") {
      any_known_ = true;
      return materials_.ReadLibraries(words.Rest(), first_line_);
    }
    if (word == "p" || word == "l") {
      any_known_ = points_or_lines_ = true;
      return absl::OkStatus();
    }
    if (IsOneOf(word, kSilent)) {
      any_known_ = true;
      return absl::OkStatus();
    }
    if (IsOneOf(word, kFreeForm)) {
      if (!std::exchange(warned_of_free_form_, true)) {
        Warn(WarningCode::kExtensionIgnored, absl::StrCat(Quote(word), " and what it is part of is ignored"));
      }
      return absl::OkStatus();
    }
    if (!std::exchange(warned_of_unknown_, true)) {
      Warn(WarningCode::kNonconformingFile, absl::StrCat(Quote(word), " is no statement of OBJ; it is ignored"));
    }
    return absl::OkStatus();
  }

  // Up to `most` numbers. Out: how many, or the error of a word that is none.
  template <typename Real>
  absl::StatusOr<int> Numbers(Words& words, Real* values, int most, const char* what) {
    int count = 0;
    for (; count < most; ++count) {
      const std::string_view word = NextNumber(words);
      if (word.empty()) break;
      if (!ReadReal(word, values[count])) return Bad(what, ": ", Quote(word), " is no number");
    }
    return count;
  }

  absl::Status Vertex(Words& words) {
    any_known_ = true;
    double position[3];
    const absl::StatusOr<int> coordinates = Numbers(words, position, 3, "a vertex");
    if (!coordinates.ok()) return coordinates.status();
    if (*coordinates < 3) return Bad("a vertex has three coordinates, not ", *coordinates);
    const Vec3d p{position[0], position[1], position[2]};
    if (!IsFinite(ToFloat(p))) return Bad("the vertex is not finite");
    float more[4];
    const absl::StatusOr<int> count = Numbers(words, more, 4, "a vertex");
    if (!count.ok()) return count.status();
    if (absl::Status full = budget_.CheckVertices(positions_.size() + 1); !full.ok()) return full;
    if (absl::Status full = budget_.MakeRoom(positions_, 1, "vertices"); !full.ok()) return full;
    positions_.push_back(p);
    if (*count == 2 && !std::exchange(warned_of_numbers_, true)) {
      Warn(WarningCode::kNonconformingFile, "a vertex of five numbers; the last two are ignored here and below");
    }
    const bool colored = *count >= 3;
    if (!colored && colors_.empty()) return absl::OkStatus();
    // White is what shaders take where there is no colour.
    const uint64_t white = positions_.size() - colors_.size() - (colored ? 1 : 0);
    if (absl::Status full = budget_.MakeRoom(colors_, white + 1, "colours"); !full.ok()) return full;
    colors_.insert(colors_.end(), white, Vec4f{1, 1, 1, 1});
    if (!colored) return absl::OkStatus();
    colors_.push_back(LinearColor({more[0], more[1], more[2], *count == 4 ? more[3] : 1.0f}));
    if (std::max({more[0], more[1], more[2]}) > 1 && !std::exchange(warned_of_colors_, true)) {
      Warn(WarningCode::kNonconformingFile, "a colour beyond 1; it is 1 here and below");
    }
    return absl::OkStatus();
  }

  absl::Status TexCoord(Words& words) {
    any_known_ = true;
    float v[3] = {0, 0, 0};
    const absl::StatusOr<int> count = Numbers(words, v, 3, "a texture coordinate");
    if (!count.ok()) return count.status();
    if (*count == 0) return Bad("a texture coordinate has one number at least");
    if (absl::Status full = budget_.MakeRoom(uv_, 1, "texture coordinates"); !full.ok()) return full;
    uv_.push_back({v[0], 1 - v[1]});
    return absl::OkStatus();
  }

  absl::Status Normal(Words& words) {
    any_known_ = true;
    float v[3];
    const absl::StatusOr<int> count = Numbers(words, v, 3, "a normal");
    if (!count.ok()) return count.status();
    if (*count < 3) return Bad("a normal has three numbers, not ", *count);
    if (absl::Status full = budget_.MakeRoom(normals_, 1, "normals"); !full.ok()) return full;
    normals_.push_back({v[0], v[1], v[2]});
    return absl::OkStatus();
  }

  // One of the up to three indices of a corner: from 1, or negative, back from the last one so far.
  absl::Status Index(const char*& at, const char* end, uint64_t count, const char* what, uint32_t& out) const {
    int64_t index = 0;
    if (at < end && *at == '+') ++at;
    const std::from_chars_result read = std::from_chars(at, end, index);
    if (read.ec != std::errc()) {
      return Bad("the index of a ", what, " is expected at ", Quote(std::string_view(at, size_t(end - at))));
    }
    at = read.ptr;
    if (index == 0) {
      return Bad("index 0 of a ", what, "; they count from 1, or with negative numbers back from the last one");
    }
    const uint64_t position = index > 0 ? uint64_t(index) - 1 : count - (~uint64_t(index) + 1);
    if (index > 0 ? uint64_t(index) > count : ~uint64_t(index) + 1 > count) {
      return Bad(what, " ", index, " does not exist: there are ", count, " above this line");
    }
    out = uint32_t(position);
    return absl::OkStatus();
  }

  absl::StatusOr<CornerMesh::Corner> ReadCorner(std::string_view word) const {
    CornerMesh::Corner corner;
    if (word.size() > kMaxNumberBytes) return Bad(Quote(word), " is longer than a corner of a face may be");
    const char *at = word.data(), *const end = word.data() + word.size();
    if (absl::Status bad = Index(at, end, positions_.size(), "vertex", corner.position); !bad.ok()) return bad;
    if (at < end && *at == '/') {
      ++at;
      if (at < end && *at != '/') {
        if (absl::Status bad = Index(at, end, uv_.size(), "texture coordinate", corner.uv); !bad.ok()) return bad;
      }
      if (at < end && *at == '/') {
        ++at;
        if (at < end) {  // "1/2/" of some files: no normal
          if (absl::Status bad = Index(at, end, normals_.size(), "normal", corner.normal); !bad.ok()) return bad;
        }
      }
    }
    if (at != end) return Bad(Quote(word), " is no corner of a face (v, v/vt, v//vn or v/vt/vn)");
    if (!colors_.empty()) corner.color = corner.position;
    return corner;
  }

  absl::Status Face(Words& words) {
    any_known_ = true;
    corners_.clear();
    for (std::string_view word = NextNumber(words); !word.empty(); word = NextNumber(words)) {
      const absl::StatusOr<CornerMesh::Corner> corner = ReadCorner(word);
      if (!corner.ok()) return corner.status();
      if (absl::Status full = budget_.MakeRoom(corners_, 1, "a face"); !full.ok()) return full;
      corners_.push_back(*corner);
    }
    if (corners_.size() < 3) ++few_corners_;
    return mesh_.AddPolygon(corners_, material_);
  }

  absl::StatusOr<Scene> Finish() {
    const auto warn = [&](WarningCode code, const std::string& what) { scene_.warnings.Add(code, "", what); };
    if (few_corners_ > 0) {
      warn(WarningCode::kNonconformingFile,
           absl::StrCat(few_corners_, " faces of fewer than three corners are ignored"));
    }
    if (mesh_.mixed()) {
      warn(WarningCode::kNonconformingFile,
           "faces of which only some corners have texture coordinates or normals; they count as without");
    }
    for (size_t i = 0; i < used_at_.size() && materials_.complete(); ++i) {
      if (i % kMaterialsAStep == 0) {
        if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
      }
      if (used_at_[i] == 0 || materials_.defined(int32_t(i))) continue;
      scene_.warnings.Add(WarningCode::kNonconformingFile, absl::StrCat("line ", used_at_[i]),
                          absl::StrCat("no material library has the material ", Quote(scene_.materials[i].name),
                                       "; it has the defaults"));
    }
    std::vector<Primitive> primitives = mesh_.Take(scene_.warnings);
    bool odd_normals = false, odd_uv = false;
    for (Primitive& primitive : primitives) {
      odd_normals = CleanNormals(budget_.job(), primitive.normals) || odd_normals;
      odd_uv = CleanUv(budget_.job(), primitive.uv[0]) || odd_uv;
    }
    if (odd_normals) warn(WarningCode::kNonconformingFile, "normals that are not finite count as 0");
    if (odd_uv) warn(WarningCode::kNonconformingFile, "texture coordinates that are not finite count as 0");
    if (primitives.empty()) {
      primitives.emplace_back();
      primitives[0].points_or_lines = points_or_lines_;
    }
    budget_.Drop(positions_);
    budget_.Drop(uv_);
    budget_.Drop(normals_);
    budget_.Drop(colors_);
    budget_.Drop(corners_);
    budget_.Drop(joined_);
    budget_.Drop(used_at_);
    Scene scene = OneMeshScene(std::move(primitives), std::move(scene_.warnings), budget_);
    scene.materials = std::move(scene_.materials);
    scene.textures = std::move(scene_.textures);
    scene.images = std::move(scene_.images);
    return scene;
  }

  TextLines lines_;
  LoadBudget& budget_;
  Scene scene_;  // materials, textures, images and warnings
  obj::Materials materials_;
  std::vector<Vec3d> positions_;
  std::vector<Vec3f> normals_;
  std::vector<Vec2f> uv_;
  std::vector<Vec4f> colors_;  // empty, or as many as positions
  CornerMesh mesh_;
  std::vector<CornerMesh::Corner> corners_;
  std::vector<char> joined_;
  std::vector<uint64_t> used_at_;  // by material: the line that uses it first, 0 for none
  int32_t material_ = -1;
  uint64_t first_line_ = 0, few_corners_ = 0;
  bool any_known_ = false, points_or_lines_ = false, warned_of_free_form_ = false, warned_of_unknown_ = false;
  bool warned_of_numbers_ = false, warned_of_colors_ = false;
};

std::string_view TextOf(std::span<const uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

bool IsObj(const JobContext& job, std::string_view text) {
  TextLines lines(text, job);
  while (const std::optional<std::string_view> line = lines.Next()) {
    const std::string_view word = Words(*line, &job).Next();
    if (word.empty() || word[0] == '#' || IsOneOf(word, kSilent)) continue;
    return IsOneOf(word, kRead);
  }
  return false;
}

absl::StatusOr<Scene> LoadObj(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  LoadBudget budget(job, limits, "OBJ");
  return ObjReader(TextOf(bytes), budget).Read();
}

}  // namespace voxelpipe
