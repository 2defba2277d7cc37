#include "load/decode/mesh_format.h"

#include <cstring>
#include <string_view>
#include <utility>

#include "load/base/text_reader.h"
#include "load/obj/obj.h"
#include "load/off/off.h"
#include "load/stl/stl.h"

namespace voxelpipe {
namespace {

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

constexpr std::pair<MeshFormat, std::string_view> kNames[] = {
    {MeshFormat::kAuto, "auto"}, {MeshFormat::kGlb, "glb"}, {MeshFormat::kGltf, "gltf"},
    {MeshFormat::kDraco, "drc"}, {MeshFormat::kStl, "stl"}, {MeshFormat::kPly, "ply"},
    {MeshFormat::kOff, "off"},   {MeshFormat::kObj, "obj"}, {MeshFormat::k3mf, "3mf"}};

// The first word of a text, and whether a line ends behind it.
std::string_view FirstWord(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string_view::npos) return {};
  text.remove_prefix(begin);
  return text.substr(0, text.find_first_of(" \t\r\n"));
}

// A ZIP archive whose first entries are those of a 3MF package; names are not compressed.
bool LooksLike3mf(std::string_view text) {
  if (text.substr(0, 4) != "PK\3\4") return false;
  for (const std::string_view name : {"[Content_Types].xml", "3D/", "_rels/.rels"}) {
    if (memmem(text.data(), text.size(), name.data(), name.size()) != nullptr) return true;
  }
  return false;
}

}  // namespace

std::string_view Name(MeshFormat format) {
  for (const auto& [known, name] : kNames) {
    if (known == format) return name;
  }
  return "";
}

std::optional<MeshFormat> MeshFormatOfName(std::string_view file_name) {
  const size_t dot = file_name.rfind('.');
  if (dot == std::string_view::npos) return std::nullopt;
  for (const auto& [format, name] : kNames) {
    if (format != MeshFormat::kAuto && SameWord(file_name.substr(dot + 1), name)) return format;
  }
  return std::nullopt;
}

std::optional<MeshFormat> SniffMeshFormat(std::span<const uint8_t> bytes, uint64_t file_bytes) {
  std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (text.substr(0, 4) == "glTF") return MeshFormat::kGlb;
  if (text.substr(0, 5) == "DRACO") return MeshFormat::kDraco;
  if (LooksLike3mf(text)) return MeshFormat::k3mf;
  if (IsBinaryStl(bytes, file_bytes == 0 ? bytes.size() : file_bytes)) return MeshFormat::kStl;
  if (text.substr(0, kByteOrderMark.size()) == kByteOrderMark) text.remove_prefix(kByteOrderMark.size());
  const std::string_view word = FirstWord(text);
  if (!word.empty() && word[0] == '{') return MeshFormat::kGltf;
  if (word == "ply") return MeshFormat::kPly;
  if (SameWord(word, "solid")) return MeshFormat::kStl;
  if (IsOff(bytes)) return MeshFormat::kOff;
  if (IsObj(bytes)) return MeshFormat::kObj;
  return std::nullopt;
}

}  // namespace voxelpipe
