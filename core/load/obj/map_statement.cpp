// Source: D. Ramey, L. Rose, L. Tyerman, "MTL material format" (1995), section "Options for texture map statements".
#include "load/obj/map_statement.h"

#include <optional>
#include <utility>

#include "load/base/flat_scene.h"
#include "load/base/text_reader.h"

namespace voxelpipe::obj {
namespace {

// Words that follow an option; of -o, -s and -t as many of three as are numbers.
std::optional<int> OptionWords(std::string_view option) {
  static constexpr std::pair<std::string_view, int> kOptions[] = {
      {"-blendu", 1},  {"-blendv", 1}, {"-boost", 1}, {"-bm", 1}, {"-cc", 1}, {"-clamp", 1},  {"-colorspace", 1},
      {"-imfchan", 1}, {"-mm", 2},     {"-o", 3},     {"-s", 3},  {"-t", 3},  {"-texres", 1}, {"-type", 1}};
  for (const auto& [name, words] : kOptions) {
    if (SameWord(option, name)) return words;
  }
  return std::nullopt;
}

}  // namespace

MapStatement ParseMapStatement(const JobContext& job, std::string_view arguments) {
  MapStatement map;
  Words words(arguments, &job);
  Words name = words;
  for (std::string_view word = words.Next(); !word.empty() && word[0] == '-'; word = words.Next()) {
    const std::optional<int> count = OptionWords(word);
    if (!count) break;  // a name that begins with "-"
    if (SameWord(word, "-clamp")) {
      map.clamp = SameWord(words.Next(), "on");
    } else if (*count == 3) {
      float* const values = SameWord(word, "-o") ? map.offset : map.scale;
      for (int i = 0; i < 3; ++i) {
        Words ahead = words;
        float value = 0;
        if (!ReadReal(ahead.Next(), value) || !IsFinite(value)) break;
        if (!SameWord(word, "-t")) values[i] = value;
        words = ahead;
      }
    } else {
      for (int i = 0; i < *count; ++i) words.Next();
    }
    name = words;
  }
  map.name = name.Rest();
  return map;
}

}  // namespace voxelpipe::obj
