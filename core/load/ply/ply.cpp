#include "load/ply/ply.h"

#include <array>
#include <limits>
#include <optional>
#include <utility>

#include "load/base/flat_scene.h"
#include "load/base/load_budget.h"
#include "load/base/polygons.h"
#include "load/ply/ply_header.h"
#include "load/ply/ply_values.h"

namespace voxelpipe {
namespace {

using ply::Element;
using ply::Header;
using ply::Property;
using ply::Type;

constexpr uint64_t kElementsAStep = 1 << 14;  // between two polls of the job

// The vertex's numbers that have a meaning, by the names of their properties.
enum Slot { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kAlpha, kU, kV, kSlots };

std::optional<Slot> SlotOf(std::string_view name) {
  static constexpr std::pair<std::string_view, Slot> kNames[] = {{"x", kX},
                                                                 {"y", kY},
                                                                 {"z", kZ},
                                                                 {"nx", kNx},
                                                                 {"ny", kNy},
                                                                 {"nz", kNz},
                                                                 {"red", kRed},
                                                                 {"green", kGreen},
                                                                 {"blue", kBlue},
                                                                 {"alpha", kAlpha},
                                                                 {"r", kRed},
                                                                 {"g", kGreen},
                                                                 {"b", kBlue},
                                                                 {"a", kAlpha},
                                                                 {"diffuse_red", kRed},
                                                                 {"diffuse_green", kGreen},
                                                                 {"diffuse_blue", kBlue},
                                                                 {"u", kU},
                                                                 {"v", kV},
                                                                 {"s", kU},
                                                                 {"t", kV},
                                                                 {"texture_u", kU},
                                                                 {"texture_v", kV}};
  for (const auto& [known, slot] : kNames) {
    if (name == known) return slot;
  }
  return std::nullopt;
}

// What a colour is divided by. Integers of 32 bits are 0 to 255 in the files that have them.
float ColorMost(Type type) {
  switch (type) {
    case Type::kFloat:
    case Type::kDouble: return 1;
    case Type::kInt16: return 32767;
    case Type::kUint16: return 65535;
    case Type::kInt8: return 127;
    default: return 255;
  }
}

template <typename Values>
class BodyReader {
 public:
  BodyReader(Values values, const Header& header, LoadBudget& budget, WarningList& warnings)
      : values_(std::move(values)), header_(header), budget_(budget), warnings_(warnings) {}

  absl::StatusOr<Primitive> Read() {
    for (const Element& element : header_.elements) {
      if (element.name == "vertex") vertices_ = element.count;
    }
    for (const Element& element : header_.elements) {
      if (absl::Status bad = CheckCount(element); !bad.ok()) return bad;
      absl::Status bad = element.name == "vertex"      ? ReadVertices(element)
                         : element.name == "face"      ? ReadFaces(element)
                         : element.name == "tristrips" ? ReadStrips(element)
                                                       : SkipElement(element);
      if (!bad.ok()) return bad;
    }
    if (absl::Status bad = AddWaiting(); !bad.ok()) return bad;
    polygons_.Finish(warnings_);
    if (const std::string unread = values_.Unread(); !unread.empty()) {
      warnings_.Add(WarningCode::kCountMismatch, "",
                    absl::StrCat(unread, " belong to no element and are ignored; the header may not fit the data"));
    }
    if (header_.names_texture) {
      warnings_.Add(WarningCode::kExtensionIgnored, "", "the comment TextureFile is ignored: PLY has no textures");
    }
    if (!has_faces_ && !has_strips_) out_.points_or_lines = true;
    return std::move(out_);
  }

 private:
  // Refuses elements of which the rest of the file cannot hold that many.
  absl::Status CheckCount(const Element& element) {
    uint64_t each = 0;
    for (const Property& property : element.properties) {
      each += values_.CostOf(property.list ? property.count_type : property.type);
    }
    if (each == 0 || element.count <= values_.left() / each) return absl::OkStatus();
    return budget_.Invalid("line ", element.line, ": ", element.count, " of the element ", Quote(element.name),
                           " do not fit into the rest of the file; it may be cut off");
  }

  absl::Status Missing(const Element& element, uint64_t row, const Property& property) const {
    return budget_.Invalid(element.name, " ", row, ", property ", Quote(property.name), ": ", values_.Fault());
  }

  absl::Status Poll(uint64_t row) const { return row % kElementsAStep == 0 ? budget_.job().Check() : absl::OkStatus(); }

  // Out: the number of values of a list, which the rest of the file can hold.
  absl::StatusOr<uint64_t> ListCount(const Element& element, uint64_t row, const Property& property) {
    int64_t count = 0;
    if (!values_.Integer(property.count_type, count)) return Missing(element, row, property);
    if (count < 0 || uint64_t(count) > values_.left() / values_.CostOf(property.type)) {
      return budget_.Invalid(element.name, " ", row, ", property ", Quote(property.name), ": a list of ", count,
                             " values does not fit into the rest of the file");
    }
    return uint64_t(count);
  }

  absl::Status SkipProperty(const Element& element, uint64_t row, const Property& property) {
    uint64_t count = 1;
    if (property.list) {
      const absl::StatusOr<uint64_t> listed = ListCount(element, row, property);
      if (!listed.ok()) return listed.status();
      count = *listed;
    }
    return values_.Skip(property.type, count) ? absl::OkStatus() : Missing(element, row, property);
  }

  absl::Status SkipElement(const Element& element) {
    if (element.count > 0) {
      warnings_.Add(WarningCode::kExtensionIgnored, absl::StrCat("line ", element.line),
                    absl::StrCat("the element ", Quote(element.name), " is ignored"));
    }
    if (element.properties.empty()) return absl::OkStatus();
    for (uint64_t row = 0; row < element.count; ++row) {
      if (absl::Status over = Poll(row); !over.ok()) return over;
      for (const Property& property : element.properties) {
        if (absl::Status bad = SkipProperty(element, row, property); !bad.ok()) return bad;
      }
    }
    return absl::OkStatus();
  }

  absl::Status ReadVertices(const Element& element) {
    std::vector<int> slots;  // of each property: a Slot, kSlots + index of an attribute, or -1
    std::array<float, kSlots> most{}, vertex{};
    std::array<bool, kSlots> has{};
    for (const Property& property : element.properties) {
      const std::optional<Slot> slot = SlotOf(property.name);
      if (property.list) {
        warnings_.Add(WarningCode::kExtensionIgnored, "vertex",
                      absl::StrCat("the list ", Quote(property.name), " is ignored"));
        slots.push_back(-1);
      } else if (slot && !has[*slot]) {
        has[*slot] = true;
        most[*slot] = ColorMost(property.type);
        slots.push_back(*slot);
      } else {
        slots.push_back(kSlots + int(out_.attributes.size()));
        out_.attributes.push_back({"_" + property.name, 1, {}});
      }
    }
    if (element.count > 0 && !(has[kX] && has[kY] && has[kZ])) {
      return budget_.Invalid("line ", element.line, ": the element vertex lacks x, y or z");
    }
    if (absl::Status full = budget_.CheckVertices(element.count); !full.ok()) return full;
    const bool normals = has[kNx] && has[kNy] && has[kNz], colors = has[kRed] && has[kGreen] && has[kBlue];
    const bool uv = has[kU] && has[kV];
    const uint64_t count = element.count;
    absl::Status full = budget_.MakeRoom(out_.positions, count, "vertices");
    if (full.ok() && normals) full = budget_.MakeRoom(out_.normals, count, "normals");
    if (full.ok() && colors) full = budget_.MakeRoom(out_.colors, count, "colours");
    if (full.ok() && uv) full = budget_.MakeRoom(out_.uv[0], count, "texture coordinates");
    for (VertexAttribute& attribute : out_.attributes) {
      if (full.ok()) full = budget_.MakeRoom(attribute.values, count, "attributes");
    }
    if (!full.ok()) return full;
    Vec3d position;
    for (uint64_t row = 0; row < count; ++row) {
      if (absl::Status over = Poll(row); !over.ok()) return over;
      for (size_t i = 0; i < slots.size(); ++i) {
        const Property& property = element.properties[i];
        if (slots[i] < 0) {
          if (absl::Status bad = SkipProperty(element, row, property); !bad.ok()) return bad;
          continue;
        }
        if (slots[i] <= kZ) {
          if (!values_.Double(property.type, position[slots[i]])) return Missing(element, row, property);
          continue;
        }
        float value = 0;
        if (!values_.Float(property.type, value)) return Missing(element, row, property);
        if (slots[i] < kSlots) {
          vertex[size_t(slots[i])] = value;
        } else {
          out_.attributes[size_t(slots[i] - kSlots)].values.push_back(IsFinite(value) ? value : 0);
          odd_attributes_ = odd_attributes_ || !IsFinite(value);
        }
      }
      if (!IsFinite(ToFloat(position))) return budget_.Invalid("vertex ", row, " is not finite");
      full = AddPosition(position, budget_, out_);
      if (!full.ok()) return full;
      if (normals) out_.normals.push_back({vertex[kNx], vertex[kNy], vertex[kNz]});
      if (uv) out_.uv[0].push_back({vertex[kU], 1 - vertex[kV]});
      if (colors) {
        out_.colors.push_back(
            LinearColor({vertex[kRed] / most[kRed], vertex[kGreen] / most[kGreen], vertex[kBlue] / most[kBlue],
                         has[kAlpha] ? vertex[kAlpha] / most[kAlpha] : 1.0f}));
      }
    }
    const auto warn = [&](const char* what) {
      warnings_.Add(WarningCode::kNonconformingFile, "vertex",
                    absl::StrCat(what, " have values that are not finite; they count as 0"));
    };
    if (CleanNormals(budget_.job(), out_.normals)) warn("normals");
    if (CleanUv(budget_.job(), out_.uv[0])) warn("texture coordinates");
    if (odd_attributes_) warn("properties");
    return absl::OkStatus();
  }

  static bool IsIndexList(const Property& property) {
    return property.list && (property.name == "vertex_indices" || property.name == "vertex_index");
  }

  // Refuses an element without a list of vertices, or with two.
  absl::Status CheckIndexList(const Element& element, bool& has_list) const {
    for (const Property& property : element.properties) {
      if (!IsIndexList(property)) continue;
      if (has_list) {
        return budget_.Invalid("line ", element.line, ": the element ", element.name, " has two lists of vertices");
      }
      has_list = true;
      if (ply::IsFloat(property.type)) {
        return budget_.Invalid("line ", element.line, ": indices of vertices of a floating-point type");
      }
    }
    if (has_list || element.count == 0) return absl::OkStatus();
    return budget_.Invalid("line ", element.line, ": the element ", element.name, " lacks the list vertex_indices");
  }

  absl::Status ReadFaces(const Element& element) {
    if (absl::Status bad = CheckIndexList(element, has_faces_); !bad.ok()) return bad;
    for (const Property& property : element.properties) {
      if (SlotOf(property.name).value_or(kX) < kRed && property.name != "texcoord") continue;
      warnings_.Add(WarningCode::kExtensionIgnored, "face",
                    absl::StrCat("the property ", Quote(property.name), " of faces is ignored"));
    }
    std::vector<uint32_t> corners;
    for (uint64_t row = 0; row < element.count && has_faces_; ++row) {
      if (absl::Status over = Poll(row); !over.ok()) return over;
      for (const Property& property : element.properties) {
        absl::Status bad =
            IsIndexList(property) ? ReadFace(element, row, property, corners) : SkipProperty(element, row, property);
        if (!bad.ok()) return bad;
      }
    }
    if (few_corners_ > 0) {
      warnings_.Add(WarningCode::kNonconformingFile, "face",
                    absl::StrCat(few_corners_, " faces of fewer than three corners are ignored"));
    }
    return absl::OkStatus();
  }

  bool IsVertex(int64_t index) const { return index >= 0 && uint64_t(index) < vertices_; }
  absl::Status NoVertex(const Element& element, uint64_t row, int64_t index) const {
    return budget_.Invalid(element.name, " ", row, ": vertex ", index, " does not exist: there are ", vertices_);
  }

  absl::Status ReadFace(const Element& element, uint64_t row, const Property& property,
                        std::vector<uint32_t>& corners) {
    const absl::StatusOr<uint64_t> count = ListCount(element, row, property);
    if (!count.ok()) return count.status();
    // `corners` only grows: it holds the longest face so far.
    const uint64_t more = *count - std::min<uint64_t>(*count, corners.size());
    if (absl::Status full = budget_.MakeRoom(corners, more, "a face"); !full.ok()) return full;
    for (uint64_t i = 0; i < *count; ++i) {
      if (i == corners.size()) {  // in steps: to touch all of the room at once takes long
        if (i > 0) {
          if (absl::Status over = budget_.job().Check(); !over.ok()) return over;
        }
        corners.resize(std::min(*count, i + kElementsAStep));
      }
      int64_t index = 0;
      if (!values_.Integer(property.type, index)) return Missing(element, row, property);
      if (!IsVertex(index)) return NoVertex(element, row, index);
      corners[i] = uint32_t(index);
    }
    if (*count < 3) ++few_corners_;
    const auto face = std::span<const uint32_t>(corners).first(*count);
    if (out_.positions.size() == vertices_) return polygons_.Add(face, out_);
    // The vertices come later, and without them a polygon has no triangles.
    if (absl::Status full = budget_.MakeRoom(waiting_, *count + 1, "faces"); !full.ok()) return full;
    waiting_.push_back(uint32_t(*count));
    waiting_.insert(waiting_.end(), face.begin(), face.end());
    return absl::OkStatus();
  }

  absl::Status AddWaiting() {
    for (size_t at = 0, faces = 0; at < waiting_.size(); at += 1 + waiting_[at], ++faces) {
      if (absl::Status over = Poll(faces); !over.ok()) return over;
      const std::span<const uint32_t> corners(&waiting_[at] + 1, waiting_[at]);
      if (absl::Status bad = polygons_.Add(corners, out_); !bad.ok()) return bad;
    }
    budget_.Drop(waiting_);
    return absl::OkStatus();
  }

  // Strips of triangles, each of which ends at an index -1. Every second triangle swaps its last two corners.
  absl::Status ReadStrips(const Element& element) {
    if (absl::Status bad = CheckIndexList(element, has_strips_); !bad.ok()) return bad;
    for (uint64_t row = 0; row < element.count && has_strips_; ++row) {
      if (absl::Status over = Poll(row); !over.ok()) return over;
      for (const Property& property : element.properties) {
        absl::Status bad =
            IsIndexList(property) ? ReadStrip(element, row, property) : SkipProperty(element, row, property);
        if (!bad.ok()) return bad;
      }
    }
    return absl::OkStatus();
  }

  absl::Status ReadStrip(const Element& element, uint64_t row, const Property& property) {
    const absl::StatusOr<uint64_t> count = ListCount(element, row, property);
    if (!count.ok()) return count.status();
    uint32_t last[2] = {0, 0};
    uint64_t corners = 0;  // of the strip so far
    for (uint64_t i = 0; i < *count; ++i) {
      if (absl::Status over = Poll(i + 1); !over.ok()) return over;
      int64_t index = 0;
      if (!values_.Integer(property.type, index)) return Missing(element, row, property);
      if (index == -1) {
        corners = 0;
        continue;
      }
      if (!IsVertex(index)) return NoVertex(element, row, index);
      const auto corner = uint32_t(index);
      if (++corners >= 3) {
        if (absl::Status full = budget_.CheckTriangles(out_.triangles.size() + 1); !full.ok()) return full;
        if (absl::Status full = budget_.MakeRoom(out_.triangles, 1, "triangles"); !full.ok()) return full;
        const bool swap = corners % 2 == 0;
        out_.triangles.push_back({last[0], swap ? corner : last[1], swap ? last[1] : corner});
      }
      last[0] = last[1];
      last[1] = corner;
    }
    return absl::OkStatus();
  }

  Values values_;
  const Header& header_;
  LoadBudget& budget_;
  WarningList& warnings_;
  Primitive out_;
  uint64_t vertices_ = 0, few_corners_ = 0;
  bool has_faces_ = false, has_strips_ = false, odd_attributes_ = false;
  Polygons polygons_{budget_};
  std::vector<uint32_t> waiting_;  // faces before the vertices: the number of corners, and the corners
};

}  // namespace

absl::StatusOr<Scene> LoadPly(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits) {
  LoadBudget budget(job, limits, "PLY");
  WarningList warnings;
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const absl::StatusOr<Header> header = ply::ReadHeader(text, budget);
  if (!header.ok()) return header.status();
  const auto read = [&](auto values) {
    return BodyReader<decltype(values)>(std::move(values), *header, budget, warnings).Read();
  };
  const uint64_t begin = std::min<uint64_t>(header->data_at, bytes.size());
  absl::StatusOr<Primitive> primitive =
      header->encoding == ply::Encoding::kAscii ? read(ply::TextValues(text.substr(begin), header->data_line, job))
      : header->encoding == ply::Encoding::kLittleEndian ? read(ply::BinaryValues<false>(bytes.subspan(begin)))
                                                         : read(ply::BinaryValues<true>(bytes.subspan(begin)));
  if (!primitive.ok()) return primitive.status();
  std::vector<Primitive> primitives;
  primitives.push_back(*std::move(primitive));
  return OneMeshScene(std::move(primitives), std::move(warnings), budget);
}

}  // namespace voxelpipe
