#include "web/download/file_export.h"

#include <filesystem>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/checksum/sha256.h"
#include "base/text.h"
#include "encode/atomic_file.h"
#include "encode/png_preview.h"
#include "encode/result_file.h"
#include "job/memory_sink.h"
#include "observe/log.h"
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

class FileExport final : public ResultExport, private ResultSink {
 public:
  FileExport(std::shared_ptr<ExportedFile> file, const VoxelizeRequest& request, bool hashed, const JobContext& job)
      : file_(std::move(file)),
        request_(request),
        job_(job),
        name_(absl::StrCat("result", std::string(file_->format.extension))),
        path_(absl::StrCat(file_->folder.path(), "/", name_)) {
    if (hashed) hash_.emplace();
  }

  ResultSink& sink() override { return *this; }

  absl::StatusOr<uint64_t> Close(JobOutcome& outcome) override {
    absl::Status status = file_->format.picture() ? Draw(outcome) : Write(outcome);
    absl::StatusOr<std::string> made = std::string();
    if (status.ok()) {
      made = file_->folder.OneFile(name_, job_);
      status = made.status();
    }
    if (!status.ok()) return WithoutPaths(std::move(status));
    file_->path = *std::move(made);
    std::error_code error;
    const uint64_t bytes = std::filesystem::file_size(file_->path, error);
    return error ? 0 : bytes;
  }

 private:
  absl::Status Begin(const ResultHeader& header) override {
    if (BytesOf(header) > file_->max_bytes) return FileTooLarge(file_->max_bytes);
    file_->warnings = {};
    WarnOfNotKept(file_->format, header, file_->warnings);
    if (absl::Status s = CheckStrict(request_, file_->warnings); !s.ok()) return s;
    if (!file_->format.picture()) {
      writer_ = file_->format.open(path_, &job_);
      return WithoutPaths(writer_->Begin(header));
    }
    memory_ = MemoryCharge(&MemoryOf(job_));
    if (absl::Status s = memory_.Grow(BytesOf(header), "the result of a picture:"); !s.ok()) return s;
    return collected_.Begin(header);
  }

  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    if (!writer_) return collected_.Write(array, bytes);
    if (hash_) hash_->Update(bytes);
    return WithoutPaths(writer_->Write(array, bytes));
  }

  absl::Status Draw(JobOutcome& outcome) {
    const VoxelizeResult& result = outcome.streamed ? (whole_ = collected_.Take()) : outcome.result;
    return WritePreview(result, path_, {}, &job_);
  }

  absl::Status Write(JobOutcome& outcome) {
    if (!outcome.streamed) {
      if (absl::Status s = WriteTo(outcome.result, *this); !s.ok()) return s;
    }
    if (hash_) writer_->set_sha256(hash_->HexDigest());
    return writer_->Commit();
  }

  const std::shared_ptr<ExportedFile> file_;
  const VoxelizeRequest request_;
  const JobContext& job_;
  const std::string name_, path_;
  std::optional<Sha256> hash_;  // for formats that store it; none if the request asks for none
  std::unique_ptr<ResultFile> writer_;
  // A picture is drawn of the whole result.
  MemoryCharge memory_;
  MemorySink collected_;
  VoxelizeResult whole_;
};

}  // namespace

MakeExport ExportTo(std::shared_ptr<ExportedFile> file) {
  return [file = std::move(file)](ParsedConfig& config,
                                  const JobContext& job) -> absl::StatusOr<std::unique_ptr<ResultExport>> {
    if (config.settings.compression != Compression::kNone) {
      return absl::InvalidArgumentError("config.compression: a file needs NONE; its format compresses by itself");
    }
    VoxelizeRequest& request = config.request;
    UseDefaultsOf(file->format, config.default_targets, config.default_result, request);
    if (absl::Status s = CheckHolds(file->format.extension, request.result, request.targets.size()); !s.ok()) return s;
    return std::make_unique<FileExport>(file, request, config.settings.content_hash, job);
  };
}

absl::Status WithoutPaths(absl::Status status) {
  if (!IsOutputError(status)) return status;
  LogMessage(LogLevel::kWarn, absl::StrCat("web: ", std::string(status.message())));
  return absl::Status(status.code(), "the server cannot write its temporary file; its log has the reason");
}

absl::Status FileTooLarge(uint64_t max_bytes) {
  return absl::ResourceExhaustedError(
      absl::StrCat("the file does not fit into what is left of --web-file-bytes, ", BytesText(max_bytes), " in all"));
}

}  // namespace voxelpipe
