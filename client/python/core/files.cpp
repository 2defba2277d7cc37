#include "files.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "base/job_context.h"
#include "base/warning.h"
#include "call.h"
#include "encode/encode.h"
#include "encode/format_registry.h"
#include "encode/result_file.h"
#include "pipeline/warnings.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

namespace py = pybind11;

constexpr size_t kPieceBytes = size_t{8} << 20;  // between two looks at the job

// A result without its arrays, and the format of its file.
struct Described {
  VoxelizeRequest request;
  ResultHeader header;
  const OutputFormat* format = nullptr;
};

absl::StatusOr<Described> Parse(const std::string& request_bytes, const std::string& header_bytes,
                                const std::string& path) {
  v1::VoxelizeRequest request_message;
  if (!request_message.ParseFromString(request_bytes)) {
    return absl::InvalidArgumentError("request: is no VoxelizeRequest");
  }
  v1::ResultHeader header_message;
  if (!header_message.ParseFromString(header_bytes)) return absl::InvalidArgumentError("header: is no ResultHeader");
  absl::StatusOr<ParsedConfig> parsed = ParseRequest(request_message);
  if (!parsed.ok()) return parsed.status();
  absl::StatusOr<ResultHeader> header = FromMessage(header_message, parsed->request);
  if (!header.ok()) return header.status();
  const std::string extension = FileExtension(path);
  const absl::Status holds = CheckHolds(extension, header->kind, header->specs);
  if (!holds.ok()) {
    const std::string why(holds.message());
    return WithField(absl::InvalidArgumentError(absl::StrCat("'", path, "': ", why)), "path");
  }
  return Described{std::move(parsed->request), *std::move(header), FindFormat(extension)};
}

absl::Status Write(const ResultHeader& header, const std::vector<std::span<const uint8_t>>& arrays,
                   const std::string& path, const JobContext& job) {
  try {
    absl::StatusOr<std::unique_ptr<ResultFile>> file = OpenResultFile(path, &job);
    if (!file.ok()) return WithField(file.status(), "path");
    if (absl::Status s = (*file)->Begin(header); !s.ok()) return s;
    for (size_t i = 0; i < arrays.size(); ++i) {
      for (size_t at = 0; at < arrays[i].size(); at += kPieceBytes) {
        if (absl::Status s = job.Check(); !s.ok()) return s;
        const size_t bytes = std::min(kPieceBytes, arrays[i].size() - at);
        if (absl::Status s = (*file)->Write(i, arrays[i].subspan(at, bytes)); !s.ok()) return s;
      }
    }
    return (*file)->Commit();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("out of memory while writing '", path, "'"));
  }
}

std::string_view Name(TargetPlaces places) {
  switch (places) {
    case TargetPlaces::kTogether: return "together";
    case TargetPlaces::kFileEach: return "file_each";
    case TargetPlaces::kOne: return "one";
    case TargetPlaces::kDrawn: return "drawn";
  }
  return "";
}

}  // namespace

py::list Formats() {
  py::list formats;
  for (const OutputFormat& format : OutputFormats()) {
    py::list kinds;
    for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
      if (format.Holds(kind)) kinds.append(py::cast(std::string(Name(kind))));
    }
    py::dict entry;
    entry["name"] = std::string(format.name);
    entry["extension"] = std::string(format.extension);
    entry["title"] = std::string(format.title);
    entry["kinds"] = py::tuple(kinds);
    entry["targets"] = std::string(Name(format.targets));
    entry["picture"] = format.picture();
    entry["directory"] = format.directory;
    formats.append(entry);
  }
  return formats;
}

std::string NotKept(const std::string& request, const std::string& header, const std::string& path) {
  const absl::StatusOr<Described> result = Parse(request, header, path);
  if (!result.ok()) Throw(result.status());
  WarningList warnings;
  WarnOfNotKept(*result->format, result->header, warnings);
  if (absl::Status s = CheckStrict(result->request, warnings); !s.ok()) Throw(s);
  return warnings.empty() ? "" : warnings.kept().front().text;
}

void WriteFile(const std::string& request, const std::string& header, const std::vector<py::buffer>& arrays,
               const std::string& path) {
  const absl::StatusOr<Described> result = Parse(request, header, path);
  if (!result.ok()) Throw(result.status());
  const std::vector<ArraySpec>& specs = result->header.arrays;
  if (arrays.size() != specs.size()) {
    Throw(absl::InvalidArgumentError(absl::StrCat("arrays: ", arrays.size(), " of ", specs.size())));
  }
  std::vector<py::buffer_info> held;  // keep the buffers while they are read
  std::vector<std::span<const uint8_t>> bytes;
  for (size_t i = 0; i < arrays.size(); ++i) {
    const py::buffer_info& info = held.emplace_back(arrays[i].request());
    if (info.ndim != 1 || (info.size > 0 && info.strides[0] != info.itemsize) ||
        uint64_t(info.size * info.itemsize) != specs[i].bytes()) {
      Throw(absl::InvalidArgumentError(
          absl::StrCat("arrays: ", specs[i].name, " is no flat buffer of ", specs[i].bytes(), " bytes")));
    }
    bytes.emplace_back(static_cast<const uint8_t*>(info.ptr), size_t(info.size * info.itemsize));
  }
  JobContext job;
  absl::Status status = absl::UnknownError("the job did not run");
  RunInterruptible([&] { job.Cancel(); }, [&] { status = Write(result->header, bytes, path, job); });
  if (!status.ok()) Throw(status);
}

}  // namespace voxelpipe
