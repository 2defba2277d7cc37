#include "load/obj/materials.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "load/base/data_uri.h"
#include "load/base/flat_scene.h"
#include "load/base/text_reader.h"
#include "load/obj/map_statement.h"

namespace voxelpipe::obj {
namespace {

constexpr uint64_t kBytesAMaterial = 512;  // beside itself: its name, its place in the table, its faults

// The numbers of a line; false if there are fewer, or one is not finite.
bool Numbers(Words words, float* values, int count) {
  for (int i = 0; i < count; ++i) {
    if (!ReadReal(words.Next(), values[i]) || !IsFinite(values[i])) return false;
  }
  return true;
}

float Unit(float value) {
  return std::clamp(value, 0.0f, 1.0f);
}

}  // namespace

absl::StatusOr<int32_t> Materials::Find(std::string_view name) {
  const auto known = ids_.find(absl::string_view(name.data(), name.size()));
  if (known != ids_.end()) return known->second;
  if (absl::Status full = budget_.Take(kBytesAMaterial + 2 * name.size(), 1, "materials"); !full.ok()) return full;
  if (absl::Status full = budget_.MakeRoom(scene_.materials, 1, "materials"); !full.ok()) return full;
  const auto id = int32_t(scene_.materials.size());
  Material& material = scene_.materials.emplace_back();
  material.name = std::string(name);
  material.metallic_factor = 0;  // MTL describes no metals, unless by Pm
  defined_.push_back(false);
  ids_.emplace(material.name, id);
  return id;
}

absl::Status Materials::ReadLibraries(std::string_view names, uint64_t line) {
  const std::string where = absl::StrCat("line ", line);
  const auto missing = [&](std::string_view name) {
    any_library_ = any_missing_ = true;
    scene_.warnings.Add(WarningCode::kTextureMissing, where,
                        absl::StrCat("the material library ", Quote(name),
                                     " is no file that could be read; materials have their defaults"));
  };
  bool any_data = false;
  Words ahead = WordsOf(names);
  for (std::string_view word = ahead.Next(); !word.empty(); word = ahead.Next()) any_data = any_data || IsDataUri(word);
  if (!any_data) {  // one name, which may hold spaces
    if (!names.empty()) missing(names);
    return absl::OkStatus();
  }
  Words words = WordsOf(names);
  for (std::string_view word = words.Next(); !word.empty(); word = words.Next()) {
    if (!IsDataUri(word)) {
      missing(word);
      continue;
    }
    any_library_ = true;
    const uint64_t before = 2 * word.size();
    MemoryCharge charge(&MemoryOf(budget_.job()));
    if (absl::Status full = charge.Grow(before, "OBJ: a material library:"); !full.ok()) return full;
    absl::StatusOr<DataUri> library = DecodeDataUri(budget_.job(), word);
    if (absl::IsInvalidArgument(library.status())) {
      return budget_.Invalid(where, ": the material library: ", std::string(library.status().message()));
    }
    if (!library.ok()) return library.status();
    const std::string_view text(reinterpret_cast<const char*>(library->bytes.data()), library->bytes.size());
    const std::string name = library->name.empty() ? absl::StrCat("the library of ", where) : Quote(library->name);
    if (absl::Status bad = ReadLibrary(text, name); !bad.ok()) return bad;
  }
  return absl::OkStatus();
}

absl::Status Materials::ReadLibrary(std::string_view text, const std::string& where) {
  current_ = -1;
  TextLines lines(text, budget_.job());
  while (const std::optional<std::string_view> line = lines.Next()) {
    Words words = WordsOf(*line);
    const std::string_view word = words.Next();
    if (word.empty() || word[0] == '#') continue;
    const std::string place = absl::StrCat(where, ", line ", lines.number());
    if (absl::Status bad = Statement(word, words.Rest(), place); !bad.ok()) return bad;
  }
  return absl::OkStatus();
}

absl::Status Materials::Statement(std::string_view word, std::string_view line, const std::string& where) {
  if (SameWord(word, "newmtl")) {
    const absl::StatusOr<int32_t> id = Find(line);
    if (!id.ok()) return id.status();
    current_ = *id;
    defined_[size_t(*id)] = true;
    return absl::OkStatus();
  }
  if (current_ < 0) {
    scene_.warnings.Add(WarningCode::kNonconformingFile, where, "a statement before the first 'newmtl' is ignored");
    return absl::OkStatus();
  }
  Material& material = scene_.materials[size_t(current_)];
  float v[3] = {0, 0, 0};
  const auto read = [&](int count) {
    if (Numbers(WordsOf(line), v, count)) return true;
    scene_.warnings.Add(
        WarningCode::kNonconformingFile, where,
        absl::StrCat(Quote(word), " needs ", count, count == 1 ? " number" : " numbers", "; it is ignored"));
    return false;
  };
  if (SameWord(word, "kd") && read(3)) {
    const float alpha = material.base_color_factor.w;
    material.base_color_factor = LinearColor({v[0], v[1], v[2], alpha});
  } else if (SameWord(word, "ke") && read(3)) {
    material.emissive_factor = {LinearOfSrgb(v[0]), LinearOfSrgb(v[1]), LinearOfSrgb(v[2])};
  } else if (SameWord(word, "d") || SameWord(word, "tr")) {
    if (!read(1)) return absl::OkStatus();
    material.base_color_factor.w = SameWord(word, "d") ? Unit(v[0]) : 1 - Unit(v[0]);
    material.alpha_mode = material.base_color_factor.w < 1 ? AlphaMode::kBlend : AlphaMode::kOpaque;
  } else if (SameWord(word, "pm") && read(1)) {
    material.metallic_factor = Unit(v[0]);
  } else if (SameWord(word, "pr") && read(1)) {
    material.roughness_factor = Unit(v[0]);
  } else if (SameWord(word, "map_kd")) {
    return ReadMap(line, material.base_color);
  } else if (SameWord(word, "map_ke")) {
    if (material.emissive_factor == Vec3f{0, 0, 0}) material.emissive_factor = {1, 1, 1};
    return ReadMap(line, material.emissive);
  } else if (SameWord(word, "map_d")) {
    scene_.warnings.Add(WarningCode::kExtensionIgnored, where, "the texture of the opacity (map_d) is ignored");
  }
  return absl::OkStatus();  // no shader reads the others
}

absl::Status Materials::ReadMap(std::string_view arguments, TextureRef& ref) {
  const MapStatement map = ParseMapStatement(budget_.job(), arguments);
  Texture texture;
  if (map.clamp) texture.wrap_s = texture.wrap_t = WrapMode::kClampToEdge;
  ref = TextureRef{};
  const absl::StatusOr<int32_t> image = ImageOf(map.name, ref.fault);
  if (!image.ok()) return image.status();
  if (*image < 0) return absl::OkStatus();
  if (absl::Status full = budget_.MakeRoom(scene_.textures, 1, "textures"); !full.ok()) return full;
  texture.image = *image;
  ref.texture = int32_t(scene_.textures.size());
  scene_.textures.push_back(texture);
  // In MTL v points up, from 0 at the bottom: v' = o + s v there is 1 - v' = (1 - o - s) + s (1 - v) here.
  ref.offset[0] = map.offset[0];
  ref.offset[1] = 1 - map.offset[1] - map.scale[1];
  ref.scale[0] = map.scale[0];
  ref.scale[1] = map.scale[1];
  return absl::OkStatus();
}

absl::StatusOr<int32_t> Materials::ImageOf(std::string_view name, std::string& fault) {
  if (!IsDataUri(name)) {
    const auto known = images_.find(absl::string_view(name.data(), name.size()));
    if (known != images_.end()) return known->second;
    fault = absl::StrCat("the file ", Quote(name), " could not be read");
    return -1;
  }
  MemoryCharge charge(&MemoryOf(budget_.job()));
  if (absl::Status full = charge.Grow(2 * name.size() + sizeof(Image), "OBJ: a texture:"); !full.ok()) return full;
  absl::StatusOr<DataUri> data = DecodeDataUri(budget_.job(), name);
  if (absl::IsInvalidArgument(data.status())) {
    fault = std::string(data.status().message());
    return -1;
  }
  if (!data.ok()) return data.status();
  if (absl::Status full = budget_.MakeRoom(scene_.images, 1, "textures"); !full.ok()) return full;
  const auto id = int32_t(scene_.images.size());
  auto image = std::make_shared<Image>();
  image->name = data->name.empty() ? absl::StrCat("image ", id) : data->name;
  image->mime_type = data->media_type;
  image->encoded = std::move(data->bytes);
  charge.ShrinkTo(image->encoded.size() + sizeof(Image));
  image->memory = std::make_shared<MemoryCharge>(std::move(charge));
  if (!data->name.empty()) images_.emplace(data->name, id);
  scene_.images.push_back(std::move(image));
  return id;
}

}  // namespace voxelpipe::obj
