#include "load/decode/mesh_format.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "load/base/text_reader.h"
#include "load/obj/obj.h"
#include "load/off/off.h"
#include "load/stl/stl.h"

namespace voxelpipe {
namespace {

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

std::string_view TextOf(std::span<const uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

constexpr std::pair<MeshFormat, std::string_view> kNames[] = {
    {MeshFormat::kAuto, "auto"}, {MeshFormat::kGlb, "glb"}, {MeshFormat::kGltf, "gltf"},
    {MeshFormat::kDraco, "drc"}, {MeshFormat::kStl, "stl"}, {MeshFormat::kPly, "ply"},
    {MeshFormat::kOff, "off"},   {MeshFormat::kObj, "obj"}, {MeshFormat::k3mf, "3mf"}};

// A ZIP archive whose first entries are those of a 3MF package; names are not compressed.
bool LooksLike3mf(const JobContext& job, std::string_view text) {
  if (text.substr(0, 4) != "PK\3\4") return false;
  for (const std::string_view name : {"[Content_Types].xml", "3D/", "_rels/.rels"}) {
    if (Contains(text, name, job)) return true;
  }
  return false;
}

// `text`: the file or, if it is `cut`, its beginning. The answer is of no use once the job is over.
MeshFormat FormatOfText(const JobContext& job, std::string_view text, bool cut) {
  if (text.substr(0, kByteOrderMark.size()) == kByteOrderMark) text.remove_prefix(kByteOrderMark.size());
  const std::string_view word = WordStream(text, 1, &job).Next();
  if (!word.empty() && word[0] == '{') return MeshFormat::kGltf;
  if (word == "ply") return MeshFormat::kPly;
  if (SameWord(word, "solid")) return MeshFormat::kStl;
  if (cut) text = text.substr(0, text.find_last_of(" \t\r\n") + 1);  // without a part of a word
  if (IsOff(job, text)) return MeshFormat::kOff;
  if (IsObj(job, text)) return MeshFormat::kObj;
  return MeshFormat::kAuto;
}

// By what files of binary formats begin with, of which `bytes` are the beginning.
MeshFormat FormatOfSignature(std::span<const uint8_t> bytes, uint64_t file_bytes) {
  const std::string_view text = TextOf(bytes);
  if (text.substr(0, 4) == "glTF") return MeshFormat::kGlb;
  if (text.substr(0, 5) == "DRACO") return MeshFormat::kDraco;
  return IsBinaryStl(bytes, file_bytes) ? MeshFormat::kStl : MeshFormat::kAuto;
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
  if (file_bytes == 0) file_bytes = bytes.size();
  bytes = bytes.first(std::min<uint64_t>(bytes.size(), kSniffedBytes));
  const JobContext endless;
  const std::string_view text = TextOf(bytes);
  MeshFormat format = FormatOfSignature(bytes, file_bytes);
  if (format == MeshFormat::kAuto && LooksLike3mf(endless, text)) format = MeshFormat::k3mf;
  if (format == MeshFormat::kAuto) format = FormatOfText(endless, text, bytes.size() < file_bytes);
  return format == MeshFormat::kAuto ? std::nullopt : std::optional(format);
}

absl::StatusOr<MeshFormat> DetectMeshFormat(const JobContext& job, std::span<const uint8_t> file) {
  if (const std::optional<MeshFormat> shown = SniffMeshFormat(file)) return *shown;
  MeshFormat format = MeshFormat::kAuto;
  if (file.size() > kSniffedBytes) {
    format = LooksLike3mf(job, TextOf(file)) ? MeshFormat::k3mf : FormatOfText(job, TextOf(file), false);
  }
  if (absl::Status over = job.Check(); !over.ok()) return over;
  return format;
}

absl::StatusOr<MeshFormat> FormatToTell(const JobContext& job, std::span<const uint8_t> file,
                                        std::string_view file_name) {
  const absl::StatusOr<MeshFormat> shown = DetectMeshFormat(job, file);
  if (!shown.ok()) return shown.status();
  return *shown != MeshFormat::kAuto ? MeshFormat::kAuto : MeshFormatOfName(file_name).value_or(MeshFormat::kAuto);
}

}  // namespace voxelpipe
