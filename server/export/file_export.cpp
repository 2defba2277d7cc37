#include "export/file_export.h"

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
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxNameBytes = 40;  // that an error shows

class FileExport final : public ResultExport, private ResultSink {
 public:
  FileExport(std::shared_ptr<ExportedFile> file, const VoxelizeRequest& request, bool hashed, JobContext& job)
      : file_(std::move(file)),
        request_(request),
        job_(job),
        name_(absl::StrCat("result", std::string(file_->format.extension))),
        path_(absl::StrCat(file_->folder.path(), "/", name_)) {
    if (hashed) hash_.emplace();
  }

  ResultSink& sink() override { return *this; }

  absl::StatusOr<uint64_t> Close(const JobOutcome& outcome) override {
    Watch();
    absl::Status status = file_->format.picture() ? Draw(outcome) : Write(outcome);
    absl::StatusOr<std::string> made = std::string();
    if (status.ok()) {
      made = file_->folder.OneFile(name_, job_);
      status = made.status();
    }
    if (absl::Status s = growth_->Check(); !s.ok()) return s;
    if (!status.ok()) return WithoutPaths(std::move(status));
    file_->path = *std::move(made);
    std::error_code error;
    const uint64_t bytes = std::filesystem::file_size(file_->path, error);
    return error ? 0 : bytes;
  }

 private:
  absl::Status Begin(const ResultHeader& header) override {
    if (BytesOf(header) > file_->max_bytes()) return FileTooLarge(file_->max_bytes());
    file_->warnings = {};
    WarnOfNotKept(file_->format, header, file_->warnings);
    if (absl::Status s = CheckStrict(request_, file_->warnings); !s.ok()) return s;
    Watch();
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
    absl::Status status = writer_->Write(array, bytes);
    if (status.ok()) return status;
    if (absl::Status s = growth_->Check(); !s.ok()) return s;
    return WithoutPaths(std::move(status));
  }

  void Watch() {
    if (!growth_) growth_.emplace(*file_, job_);
  }

  absl::Status Draw(const JobOutcome& outcome) {
    const VoxelizeResult& result = outcome.streamed ? (whole_ = collected_.Take()) : outcome.result;
    return WritePreview(result, path_, {}, &job_);
  }

  absl::Status Write(const JobOutcome& outcome) {
    if (!outcome.streamed) {
      if (absl::Status s = WriteTo(outcome.result, *this); !s.ok()) return s;
    }
    if (hash_) writer_->set_sha256(hash_->HexDigest());
    return writer_->Commit();
  }

  const std::shared_ptr<ExportedFile> file_;
  const VoxelizeRequest request_;
  JobContext& job_;
  const std::string name_, path_;
  std::optional<ExportedFile::Growth> growth_;  // once something may be written
  std::optional<Sha256> hash_;                  // for formats that store it; none if the request asks for none
  std::unique_ptr<ResultFile> writer_;
  // A picture is drawn of the whole result.
  MemoryCharge memory_;
  MemorySink collected_;
  VoxelizeResult whole_;
};

}  // namespace

absl::StatusOr<const OutputFormat*> ExportFormatNamed(const std::string& name) {
  const std::string extension = absl::StrCat(".", name);
  const OutputFormat* const format = FindFormat(extension);
  if (format != nullptr) return format;
  const std::string why(WhyNotBuilt(extension));
  return absl::InvalidArgumentError(
      why.empty() ? absl::StrCat("format: '", CleanText(name, kMaxNameBytes), "' is not one of ", ListFormats(false))
                  : absl::StrCat("format: ", why));
}

MakeExport ExportTo(std::shared_ptr<ExportedFile> file) {
  return
      [file = std::move(file)](ParsedConfig& config, JobContext& job) -> absl::StatusOr<std::unique_ptr<ResultExport>> {
        if (config.settings.compression != Compression::kNone) {
          return absl::InvalidArgumentError("compression: a file needs NONE; its format compresses by itself");
        }
        VoxelizeRequest& request = config.request;
        UseDefaultsOf(file->format, config.default_targets, config.default_result, request);
        if (absl::Status s = CheckHolds(file->format.extension, request.result, request.targets); !s.ok())
          return s;
        return std::make_unique<FileExport>(file, request, config.settings.content_hash, job);
      };
}

}  // namespace voxelpipe
