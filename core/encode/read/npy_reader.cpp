// Source: as npy.cpp.
#include "encode/read/npy_reader.h"

#include <cstring>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

// A reader of the header's dictionary: a Python literal with three keys, of which NumPy writes one form only.
class Literal {
 public:
  explicit Literal(std::string_view text) : text_(text) {}

  // Skips blanks, then takes `token` if it comes next.
  bool Take(std::string_view token) {
    SkipBlanks();
    if (text_.substr(at_, token.size()) != token) return false;
    at_ += token.size();
    return true;
  }
  bool TakeText(std::string& out) {
    if (!Take("'")) return false;
    const size_t end = text_.find('\'', at_);
    if (end == std::string_view::npos) return false;
    out = std::string(text_.substr(at_, end - at_));
    at_ = end + 1;
    return true;
  }
  bool TakeNumber(uint64_t& out) {
    SkipBlanks();
    size_t end = at_;
    while (end < text_.size() && text_[end] >= '0' && text_[end] <= '9') ++end;
    const bool read = absl::SimpleAtoi(absl::string_view(text_.data() + at_, end - at_), &out);
    at_ = end;
    return read;
  }
  bool AtEnd() {
    SkipBlanks();
    return at_ == text_.size();
  }

 private:
  void SkipBlanks() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n')) ++at_;
  }

  std::string_view text_;
  size_t at_ = 0;
};

struct Dictionary {
  std::string descr;
  std::string order;
  std::vector<uint64_t> shape;
};

bool TakeShape(Literal& in, std::vector<uint64_t>& shape) {
  constexpr size_t kMaxAxes = 8;
  if (!in.Take("(")) return false;
  while (!in.Take(")")) {
    uint64_t n = 0;
    if (shape.size() == kMaxAxes || !in.TakeNumber(n)) return false;
    shape.push_back(n);
    if (!in.Take(",")) return in.Take(")");
  }
  return true;
}

bool Parse(std::string_view text, Dictionary& out) {
  Literal in(text);
  if (!in.Take("{")) return false;
  int keys = 0;
  while (!in.Take("}")) {
    std::string key;
    if (!in.TakeText(key) || !in.Take(":")) return false;
    if (key == "descr" && out.descr.empty()) {
      if (!in.TakeText(out.descr) || out.descr.empty()) return false;
    } else if (key == "fortran_order" && out.order.empty()) {
      out.order = in.Take("False") ? "C" : in.Take("True") ? "Fortran" : "";
      if (out.order.empty()) return false;
    } else if (key == "shape") {
      if (!out.shape.empty() || !TakeShape(in, out.shape)) return false;
    } else {
      return false;
    }
    ++keys;
    if (!in.Take(",")) {
      if (!in.Take("}")) return false;
      break;
    }
  }
  return keys == 3 && !out.descr.empty() && !out.order.empty() && in.AtEnd();
}

}  // namespace

absl::StatusOr<StoredArray> ReadNpyHeader(std::shared_ptr<const InputFile> file, uint64_t begin, uint64_t end,
                                          const std::string& where) {
  const auto bad = [&](std::string_view what) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": ", std::string(what)));
  };
  constexpr uint64_t kMaxHeaderBytes = 64 << 10;
  uint8_t head[12] = {};
  if (end - begin < sizeof head) return bad("too short for a .npy");
  if (absl::Status s = file->ReadAt(begin, head); !s.ok()) return s;
  if (std::memcmp(head, "\x93NUMPY", 6) != 0) return bad("not a .npy: it does not begin with \\x93NUMPY");
  const int version = head[6];
  if (version < 1 || version > 3)
    return bad(absl::StrCat("version ", version, ".", int(head[7]), " of .npy, not 1 to 3"));
  const uint64_t prefix = version == 1 ? 10 : 12;
  uint64_t length = head[8] | uint64_t{head[9]} << 8;
  if (version > 1) length |= uint64_t{head[10]} << 16 | uint64_t{head[11]} << 24;
  if (length > kMaxHeaderBytes) return bad(absl::StrCat("a header of ", length, " bytes, at most ", kMaxHeaderBytes));
  if (length > end - begin - prefix) return bad("ends within its header");
  std::string text(length, '\0');
  if (absl::Status s = file->ReadAt(begin + prefix, {reinterpret_cast<uint8_t*>(text.data()), text.size()}); !s.ok()) {
    return s;
  }
  Dictionary dictionary;
  if (!Parse(text, dictionary)) return bad(absl::StrCat("the header is not NumPy's: ", CleanText(text, 80)));
  if (dictionary.order != "C") return bad("Fortran order; VoxelPipe's arrays are in C order");
  const std::optional<StoredType> type = ParseStoredType(dictionary.descr);
  if (!type || *type == StoredType::kBit) {
    return bad(absl::StrCat("elements of type '", CleanText(dictionary.descr, 40), "', which no result has"));
  }
  StoredArray array{where, std::move(file), begin + prefix + length, *type, std::move(dictionary.shape)};
  const std::optional<uint64_t> count = ElementsOf(array.shape);
  const std::optional<uint64_t> bytes = count ? StoredBytes(*type, *count) : std::nullopt;
  const uint64_t there = end - array.offset;
  if (!bytes) return bad("its shape has too many elements");
  if (*bytes != there) return bad(absl::StrCat("its shape needs ", *bytes, " bytes, there are ", there));
  return array;
}

}  // namespace voxelpipe
