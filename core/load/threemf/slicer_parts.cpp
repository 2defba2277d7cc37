#include "load/threemf/slicer_parts.h"

#include <string>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "load/base/text_reader.h"
#include "load/threemf/xml_events.h"

namespace voxelpipe::threemf {
namespace {

constexpr std::string_view kEntries[] = {"Metadata/Slic3r_PE_model.config", "Metadata/model_settings.config"};
constexpr size_t kMaxNameBytes = 256;

// How a kind of part is read; empty: as a solid, which it is.
std::string_view HowRead(std::string_view kind) {
  if (kind == "NegativeVolume" || kind == "negative_part") return "a slicer cuts it away; here it is a solid";
  if (kind == "ParameterModifier" || kind == "modifier_part" || kind == "SupportBlocker" || kind == "support_blocker" ||
      kind == "SupportEnforcer" || kind == "support_enforcer") {
    return "a slicer does not print it; here it is a solid";
  }
  return "";
}

// The parts of one settings file: elements `volume` with metadata volume_type (PrusaSlicer), or `part` with subtype.
class PartsReader {
 public:
  PartsReader(std::string entry, WarningList& warnings) : entry_(std::move(entry)), warnings_(warnings) {}

  absl::Status Begin(std::string_view name, const Attributes& attributes) {
    const auto text = [&](std::string_view attribute) {
      const char* const value = attributes.Find(attribute);
      return std::string(value == nullptr ? "" : value).substr(0, kMaxNameBytes);
    };
    if (name == "volume" || name == "part") {
      in_part_ = true;
      kind_ = text("subtype");
      name_.clear();
    } else if (name == "metadata" && in_part_) {
      const std::string key = text("key");
      if (key == "name") name_ = text("value");
      if (key == "volume_type") kind_ = text("value");
    }
    return absl::OkStatus();
  }
  absl::Status End(std::string_view name) {
    if (name != "volume" && name != "part") return absl::OkStatus();
    in_part_ = false;
    if (const std::string_view how = HowRead(kind_); !how.empty()) {
      warnings_.Add(WarningCode::kExtensionIgnored, entry_,
                    absl::StrCat("the part ", Quote(name_), " is a ", kind_, ": ", std::string(how)));
    }
    return absl::OkStatus();
  }

 private:
  const std::string entry_;
  WarningList& warnings_;
  bool in_part_ = false;
  std::string kind_, name_;
};

}  // namespace

absl::Status WarnOfSlicerParts(ZipArchive& archive, LoadBudget& budget, WarningList& warnings) {
  for (const std::string_view part : kEntries) {
    const std::string entry = archive.Find(part);
    if (entry.empty()) continue;
    PartsReader parts(entry, warnings);
    XmlEvents xml(
        entry, budget,
        [&](std::string_view name, const Attributes& attributes) { return parts.Begin(name, attributes); },
        [&](std::string_view name) { return parts.End(name); });
    absl::Status status = archive.Unpack(entry, [&](std::span<const uint8_t> piece) { return xml.Parse(piece); });
    if (status.ok()) status = xml.Finish();
    if (absl::IsInvalidArgument(status)) {
      warnings.Add(WarningCode::kNonconformingFile, entry, "the settings of a slicer cannot be read; they are ignored");
    } else if (!status.ok()) {
      return status;
    }
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::threemf
