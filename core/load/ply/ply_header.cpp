#include "load/ply/ply_header.h"

#include <algorithm>
#include <optional>

#include "absl/strings/match.h"
#include "load/base/text_reader.h"

namespace voxelpipe::ply {
namespace {

constexpr size_t kMaxElements = 64, kMaxProperties = 256;  // of one element
constexpr size_t kMaxNameBytes = 1024;

std::optional<Type> TypeOf(std::string_view name) {
  static constexpr struct {
    std::string_view name, other;
    Type type;
  } kTypes[] = {{"char", "int8", Type::kInt8},      {"uchar", "uint8", Type::kUint8},
                {"short", "int16", Type::kInt16},   {"ushort", "uint16", Type::kUint16},
                {"int", "int32", Type::kInt32},     {"uint", "uint32", Type::kUint32},
                {"float", "float32", Type::kFloat}, {"double", "float64", Type::kDouble}};
  for (const auto& known : kTypes) {
    if (name == known.name || name == known.other) return known.type;
  }
  return std::nullopt;
}

class HeaderReader {
 public:
  HeaderReader(std::string_view text, const LoadBudget& budget) : lines_(text, budget.job()), budget_(budget) {}

  absl::StatusOr<Header> Read() {
    const std::optional<std::string_view> first = lines_.Next();
    if (!first || Words(*first).Next() != "ply") return Bad("a PLY file begins with 'ply'");
    while (const std::optional<std::string_view> line = lines_.Next()) {
      Words words(*line, &budget_.job());
      const std::string_view word = words.Next();
      if (word == "end_header") return Finish();
      if (absl::Status bad = Statement(word, words); !bad.ok()) return bad;
    }
    return Bad("the header has no 'end_header'; the file may be cut off");
  }

 private:
  template <typename... Parts>
  absl::Status Bad(const Parts&... what) const {
    return budget_.Invalid("line ", std::max<uint64_t>(1, lines_.number()), ": ", what...);
  }

  absl::StatusOr<Header> Finish() {
    if (!has_format_) return Bad("the header has no 'format'");
    header_.data_at = lines_.at();
    header_.data_line = lines_.number() + 1;
    return std::move(header_);
  }

  absl::Status Statement(std::string_view word, Words& words) {
    if (word == "comment") {
      header_.names_texture = header_.names_texture || words.Next() == "TextureFile";
      return absl::OkStatus();
    }
    if (word.empty() || word == "obj_info") return absl::OkStatus();
    if (word == "format") return Format(words);
    if (word == "element") return AddElement(words);
    if (word == "property") return AddProperty(words);
    return Bad(Quote(word), " is no statement of a header (format, element, property, comment, obj_info, end_header)");
  }

  absl::Status Format(Words& words) {
    const std::string_view name = words.Next();
    if (name == "ascii") {
      header_.encoding = Encoding::kAscii;
    } else if (name == "binary_little_endian") {
      header_.encoding = Encoding::kLittleEndian;
    } else if (name == "binary_big_endian") {
      header_.encoding = Encoding::kBigEndian;
    } else {
      return Bad("the format ", Quote(name), " is none of ascii, binary_little_endian, binary_big_endian");
    }
    has_format_ = true;
    return absl::OkStatus();
  }

  absl::Status CheckName(std::string_view name) const {
    return name.size() <= kMaxNameBytes ? absl::OkStatus()
                                        : Bad("the name ", Quote(name), " has more than ", kMaxNameBytes, " bytes");
  }

  absl::Status AddElement(Words& words) {
    if (header_.elements.size() == kMaxElements) return Bad("more than ", kMaxElements, " elements");
    Element element;
    const std::string_view name = words.Next();
    if (absl::Status bad = CheckName(name); !bad.ok()) return bad;
    element.name = std::string(name);
    element.line = lines_.number();
    const std::string_view count = words.Next();
    int64_t value = 0;
    if (element.name.empty() || !ReadInteger(count, value) || value < 0) {
      return Bad("an element has a name and a number, which is not negative");
    }
    for (const Element& other : header_.elements) {
      if (other.name == element.name) return Bad("a second element ", Quote(element.name));
    }
    element.count = uint64_t(value);
    header_.elements.push_back(std::move(element));
    return absl::OkStatus();
  }

  absl::Status AddProperty(Words& words) {
    if (header_.elements.empty()) return Bad("a property before the first element");
    Element& element = header_.elements.back();
    if (element.properties.size() == kMaxProperties) return Bad("more than ", kMaxProperties, " properties");
    Property property;
    std::string_view type = words.Next();
    if (type == "list") {
      property.list = true;
      const std::string_view count = words.Next();
      const std::optional<Type> known = TypeOf(count);
      if (!known || IsFloat(*known)) return Bad(Quote(count), " is no type of integers for the length of a list");
      property.count_type = *known;
      type = words.Next();
    }
    const std::optional<Type> known = TypeOf(type);
    if (!known) return Bad(Quote(type), " is no type (char, uchar, short, ushort, int, uint, float, double)");
    property.type = *known;
    const std::string_view name = words.Next();
    if (absl::Status bad = CheckName(name); !bad.ok()) return bad;
    property.name = std::string(name);
    if (property.name.empty()) return Bad("a property without a name");
    for (const Property& other : element.properties) {
      if (other.name == property.name) return Bad("a second property ", Quote(property.name));
    }
    element.properties.push_back(std::move(property));
    return absl::OkStatus();
  }

  TextLines lines_;
  const LoadBudget& budget_;
  Header header_;
  bool has_format_ = false;
};

}  // namespace

uint64_t SizeOf(Type type) {
  switch (type) {
    case Type::kInt8:
    case Type::kUint8: return 1;
    case Type::kInt16:
    case Type::kUint16: return 2;
    case Type::kInt32:
    case Type::kUint32:
    case Type::kFloat: return 4;
    case Type::kDouble: return 8;
  }
  return 8;
}

absl::StatusOr<Header> ReadHeader(std::string_view text, const LoadBudget& budget) {
  return HeaderReader(text, budget).Read();
}

}  // namespace voxelpipe::ply
