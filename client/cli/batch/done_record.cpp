#include "batch/done_record.h"

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/encode.h"
#include "encode/output_path.h"
#include "engine/hash.h"
#include "engine/report.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

// Incremented when the files of an unchanged request change, so that they are written again.
constexpr int kFormatVersion = 1;
// The same for pictures alone.
constexpr int kPictureVersion = 2;

// The size of a file, or of all files in a directory.
uint64_t BytesAt(const fs::path& path, std::error_code& error) {
  if (!fs::is_directory(path, error)) return error ? 0 : uint64_t(fs::file_size(path, error));
  uint64_t bytes = 0;
  for (fs::recursive_directory_iterator at(path, error), end; !error && at != end; at.increment(error)) {
    if (at->is_regular_file(error)) bytes += uint64_t(at->file_size(error));
  }
  return bytes;
}

absl::StatusOr<DoneRecord> Parse(std::istream& in) {
  DoneRecord record;
  try {
    const ordered_json json = ordered_json::parse(in);
    record.key = json.at("key").get<std::string>();
    record.hash = json.at("hash").get<std::string>();
    record.bytes = json.at("bytes").get<uint64_t>();
    for (const ordered_json& file : json.at("files")) {
      record.files.push_back({file.at("name").get<std::string>(), file.at("bytes").get<uint64_t>()});
    }
    if (const auto warnings = json.find("warnings"); warnings != json.end()) {
      for (const ordered_json& warning : *warnings) {
        const std::optional<WarningCode> code = WarningCodeOf(warning.at("code").get<std::string>());
        record.warnings.Add(code.value_or(WarningCode::kNonconformingFile), warning.at("place").get<std::string>(),
                            warning.at("text").get<std::string>());
      }
      record.warnings.set_left_out(json.value("warnings_left_out", uint64_t{0}));
    }
  } catch (const nlohmann::json::exception& error) {
    return absl::NotFoundError(error.what());  // another file, or of another version
  }
  return record;
}

}  // namespace

absl::StatusOr<std::string> ItemKey(const BatchItem& item, const std::string& input_sha256) {
  const bool picture = !item.preview.empty() || FileExtension(item.output) == ".png";
  const std::string view =
      picture ? absl::StrCat("picture ", kPictureVersion, " ", item.view.azimuth, " ", item.view.elevation, "\n") : "";
  // Only if set, so that earlier records stay valid.
  const std::string unit =
      item.type.unit == LengthUnit::kNone ? "" : absl::StrCat("unit ", std::string(Name(item.type.unit)), "\n");
  const std::string format = item.type.format == MeshFormat::kAuto
                                 ? ""
                                 : absl::StrCat("input format ", std::string(Name(item.type.format)), "\n");
  const std::string text = absl::StrCat("voxelpipe batch ", kFormatVersion, "\n", item.request->digest, "\n",
                                        input_sha256, "\n", item.output, "\n", item.preview, "\n",
                                        FileExtension(item.output) == ".raw" ? "described\n" : "", view, unit, format);
  return Sha256Hex({reinterpret_cast<const uint8_t*>(text.data()), text.size()});
}

std::string RecordPath(const std::string& output_dir, const BatchItem& item) {
  const std::string path = (fs::path(output_dir) / kRecordDirectory / item.output).string();
  return FitFileName(path, std::string(".json").size()) + ".json";
}

absl::StatusOr<DoneRecord> FindRecord(const std::string& output_dir, const BatchItem& item, const std::string& key) {
  std::ifstream in(RecordPath(output_dir, item), std::ios::binary);
  if (!in) return absl::NotFoundError("no record");
  absl::StatusOr<DoneRecord> record = Parse(in);
  if (!record.ok()) return record;
  if (record->key != key || record->files.empty()) return absl::NotFoundError("the record is of another request");
  for (const DoneRecord::File& file : record->files) {
    std::error_code error;
    if (BytesAt(fs::path(output_dir) / file.name, error) != file.bytes || error) {
      return absl::NotFoundError(absl::StrCat(file.name, " is not there as it was written"));
    }
  }
  return record;
}

absl::Status RemoveRecord(const std::string& output_dir, const BatchItem& item) {
  const std::string path = RecordPath(output_dir, item);
  std::error_code error;
  fs::remove(path, error);
  return error ? absl::ErrnoToStatus(error.value(), absl::StrCat("cannot remove '", path, "'")) : absl::OkStatus();
}

absl::Status WriteRecord(const std::string& output_dir, const BatchItem& item, DoneRecord record) {
  ordered_json files = ordered_json::array();
  for (DoneRecord::File& file : record.files) {
    std::error_code error;
    const fs::path path = fs::path(output_dir) / file.name;
    file.bytes = BytesAt(path, error);
    if (error) return absl::ErrnoToStatus(error.value(), absl::StrCat("'", path.string(), "'"));
    files.push_back({{"name", file.name}, {"bytes", file.bytes}});
  }
  ordered_json json = {{"key", record.key}, {"hash", record.hash}, {"bytes", record.bytes}, {"files", files}};
  if (!record.warnings.empty()) AddWarnings(record.warnings, json);
  const std::string text = json.dump(-1, ' ', true, ordered_json::error_handler_t::replace) + "\n";
  const std::string path = RecordPath(output_dir, item);
  std::error_code ignored;  // creating the file reports the error
  fs::create_directories(fs::path(path).parent_path(), ignored);
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(path);
  if (!file.ok()) return file.status();
  if (absl::Status s = file->Write({reinterpret_cast<const uint8_t*>(text.data()), text.size()}); !s.ok()) return s;
  return file->Commit();
}

}  // namespace voxelpipe::cli
