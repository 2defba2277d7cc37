#include "engine/run_to_files.h"

#include <filesystem>

#include "encode/atomic_file.h"
#include "encode/encode.h"
#include "encode/format_registry.h"
#include "encode/png_preview.h"
#include "encode/result_file.h"
#include "engine/clock.h"
#include "engine/hash.h"
#include "job/part_receiver.h"
#include "pipeline/warnings.h"

namespace voxelpipe::cli {
namespace {

// Creates the directories above a file. WriteResult and OpenResultFile report the path if it still cannot be created.
void MakeDirectories(const std::string& path) {
  const std::filesystem::path parent = std::filesystem::path(path).parent_path();
  std::error_code ignored;
  if (!parent.empty()) std::filesystem::create_directories(parent, ignored);
}

absl::Status WritePictureToStandardOutput(const VoxelizeResult& result, const PreviewOptions& options,
                                          const JobContext& job) {
  const absl::StatusOr<Picture> picture = RenderPreview(result, options, &job);
  if (!picture.ok()) return picture.status();
  const absl::StatusOr<std::vector<uint8_t>> png = EncodePng(*picture, &job);
  if (!png.ok()) return png.status();
  absl::StatusOr<AtomicFile> file = AtomicFile::StandardOutput();
  if (!file.ok()) return file.status();
  if (absl::Status status = file->Write(*png, &job); !status.ok()) return status;
  return file->Commit();
}

absl::Status WritePictures(const VoxelizeResult& result, const OutputPlan& plan, JobContext& job,
                           VoxelizeReport& report) {
  PreviewOptions options;
  options.view = plan.view;
  for (const std::string& path : {plan.result, plan.preview}) {
    if (path.empty() || FileExtension(path) != ".png") continue;
    job.Report("encode", 0.5);
    MakeDirectories(path);
    if (absl::Status status = WritePreview(result, path, options, &job); !status.ok()) return status;
    report.files.push_back(path);
  }
  if (plan.standard_output != ".png") return absl::OkStatus();
  job.Report("encode", 0.5);
  report.files.emplace_back("-");
  return WritePictureToStandardOutput(result, options, job);
}

// Null if the plan has no file but pictures.
absl::StatusOr<std::unique_ptr<ResultFile>> OpenFile(const OutputPlan& plan, const JobContext& job) {
  if (!plan.standard_output.empty()) {
    if (plan.standard_output == ".png") return std::unique_ptr<ResultFile>();
    return OpenStandardOutput(plan.standard_output, &job);
  }
  if (plan.result.empty() || FileExtension(plan.result) == ".png") return std::unique_ptr<ResultFile>();
  MakeDirectories(plan.result);
  return OpenResultFile(plan.result, &job);
}

// Warns of what the format of the file does not hold.
void AddNotKept(const OutputPlan& plan, const ResultHeader& header, WarningList& warnings) {
  const OutputFormat* const format =
      FindFormat(plan.standard_output.empty() ? FileExtension(plan.result) : plan.standard_output);
  if (format != nullptr) WarnOfNotKept(*format, header, warnings);
}

// Measures the time of writing a file, reports the number of voxels to on_grid, and keeps a copy of the table of parts.
class TimedSink final : public ResultSink {
 public:
  TimedSink(ResultSink* next, const OnGrid& on_grid) : next_(next), on_grid_(on_grid) {}
  absl::Status Begin(const ResultHeader& header) override {
    if (on_grid_) on_grid_(header.grid.voxels());
    parts_.Begin(header);
    return Timed([&] { return next_->Begin(header); });
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    parts_.Take(array, bytes);
    return Timed([&] { return next_->Write(array, bytes); });
  }
  double milliseconds() const { return milliseconds_; }
  const PartTable& parts() const { return parts_.table(); }

 private:
  template <typename Call>
  absl::Status Timed(const Call& call) {
    if (next_ == nullptr) return absl::OkStatus();
    const Stopwatch clock;
    absl::Status status = call();
    milliseconds_ += clock.Milliseconds();
    return status;
  }

  ResultSink* next_;
  const OnGrid& on_grid_;
  PartReceiver parts_;
  double milliseconds_ = 0;
};

}  // namespace

absl::StatusOr<EngineRun> RunToFiles(Engine& engine, MeshInputs meshes, const VoxelizeRequest& request, int repeat,
                                     const OutputPlan& plan, JobContext& job, VoxelizeReport& report,
                                     const OnGrid& on_grid) {
  absl::StatusOr<std::unique_ptr<ResultFile>> opened = OpenFile(plan, job);
  if (!opened.ok()) return opened.status();
  const std::unique_ptr<ResultFile> file = *std::move(opened);
  const bool has_result = !plan.result.empty() || !plan.standard_output.empty();
  const bool picture = !plan.preview.empty() || (has_result && file == nullptr);
  TimedSink timed(file.get(), on_grid);
  HashingSink sink(&timed);
  VoxelizeResult whole;
  WarningList warnings;
  for (const MeshInput& mesh : meshes.files) warnings.Append(mesh.warnings);
  if (absl::Status s = CheckStrict(request, warnings); !s.ok()) return s;
  absl::StatusOr<EngineRun> run = engine.Run(std::move(meshes), request, repeat, job, sink, picture ? &whole : nullptr);
  if (!run.ok()) return run.status();
  warnings.Append(run->runs.back().warnings);
  if (file != nullptr) {
    AddNotKept(plan, sink.header(), warnings);
    if (absl::Status s = CheckStrict(request, warnings); !s.ok()) return s;
  }
  run->warnings = std::move(warnings);
  report.header = sink.header();
  report.parts = timed.parts();
  report.bytes = sink.bytes();
  report.hash = sink.Digest();
  const Stopwatch encode;
  if (file != nullptr) {
    file->set_sha256(report.hash);
    if (absl::Status status = file->Commit(); !status.ok()) return status;
    report.files = plan.standard_output.empty() ? WrittenPaths(plan.result, request.targets.size())
                                                : std::vector<std::string>{"-"};
  }
  if (absl::Status status = WritePictures(whole, plan, job, report); !status.ok()) return status;
  report.encode_ms = timed.milliseconds() + encode.Milliseconds();
  report.encoded = file != nullptr || picture;
  report.peak_bytes = run->server_peak_bytes.value_or(ProcessPeakBytes());
  return run;
}

}  // namespace voxelpipe::cli
