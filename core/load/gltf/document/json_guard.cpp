#include "load/gltf/document/json_guard.h"

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {

absl::Status GuardJson(const JobContext& job, std::string_view json, const LoadLimits& limits) {
  if (json.size() > limits.max_json_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the JSON has ", json.size(), " bytes; the limit max_json_bytes is ", limits.max_json_bytes));
  }
  uint32_t depth = 0;
  bool in_string = false;
  constexpr size_t kStep = 1 << 20;  // characters between two polls of the job
  size_t look = kStep;
  for (size_t i = 0; i < json.size(); ++i) {
    if (i >= look) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
      look = i + kStep;
    }
    const char c = json[i];
    if (in_string) {
      if (c == '\\') {
        ++i;
      } else if (c == '"') {
        in_string = false;
      }
      continue;
    }
    if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      if (++depth > limits.max_json_depth) {
        return absl::ResourceExhaustedError(
            absl::StrCat("JSON byte ", i, ": nested deeper than the limit max_json_depth, ", limits.max_json_depth));
      }
    } else if (c == '}' || c == ']') {
      if (depth > 0) --depth;
    }
  }
  return absl::OkStatus();
}

std::string_view WithoutByteOrderMark(std::string_view json, WarningList& warnings) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (json.substr(0, kMark.size()) != kMark) return json;
  warnings.Add(WarningCode::kNonconformingFile, "", "the JSON begins with a byte order mark, which glTF forbids");
  return json.substr(kMark.size());
}

std::string Quoted(std::string_view text) {
  constexpr size_t kLongest = 80;
  const absl::string_view head(text.data(), text.size() < kLongest ? text.size() : kLongest);
  return absl::StrCat("'", absl::CHexEscape(head), text.size() > kLongest ? "...'" : "'");
}

}  // namespace voxelpipe
