#include <exception>
#include <filesystem>
#include <new>

#include "absl/strings/str_cat.h"
#include "clock.h"
#include "commands/commands.h"
#include "encode/encode.h"
#include "encode/png_preview.h"
#include "encode/result_file.h"
#include "engine.h"
#include "hash.h"
#include "interrupt.h"
#include "output_plan.h"
#include "progress_bar.h"
#include "report.h"
#include "request_flags.h"
#include "request_options.h"
#include "server_option.h"

namespace voxelpipe::cli {
namespace {

struct VoxelizeArguments {
  std::vector<std::string> inputs;
  std::string output, preview, server;
  RequestOptions request;
  int repeat = 1;
  bool json = false;
};

// The directories above a file. WriteResult and OpenResultFile name the path if it still cannot be made.
void MakeDirectories(const std::string& path) {
  const std::filesystem::path parent = std::filesystem::path(path).parent_path();
  std::error_code ignored;
  if (!parent.empty()) std::filesystem::create_directories(parent, ignored);
}

absl::Status WritePictures(const VoxelizeResult& result, const OutputPlan& plan, JobContext& job,
                           VoxelizeReport& report) {
  for (const std::string& path : {plan.result, plan.preview}) {
    if (path.empty() || FileExtension(path) != ".png") continue;
    job.Report("encode", 0.5);
    MakeDirectories(path);
    if (absl::Status status = WriteResult(result, path, &job); !status.ok()) return status;
    report.files.push_back(path);
  }
  return absl::OkStatus();
}

// Keeps the time that a file takes.
class TimedSink final : public ResultSink {
 public:
  explicit TimedSink(ResultSink* next) : next_(next) {}
  absl::Status Begin(const ResultHeader& header) override {
    return Timed([&] { return next_->Begin(header); });
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    return Timed([&] { return next_->Write(array, bytes); });
  }
  double milliseconds() const { return milliseconds_; }

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
  double milliseconds_ = 0;
};

absl::Status VoxelizeOne(Engine& engine, const std::string& input, const OutputPlan& plan,
                         const VoxelizeRequest& request, const VoxelizeArguments& arguments) {
  ProgressBar bar;
  JobContext job([&bar](std::string_view stage, double fraction) { bar.Show(stage, fraction); });
  const CancelOnInterrupt cancel(job);
  try {
    // Arrays go to their file as they are made; only a picture needs the whole result.
    std::unique_ptr<ResultFile> file;
    if (!plan.result.empty() && FileExtension(plan.result) != ".png") {
      MakeDirectories(plan.result);
      absl::StatusOr<std::unique_ptr<ResultFile>> opened = OpenResultFile(plan.result, &job);
      if (!opened.ok()) return opened.status();
      file = *std::move(opened);
    }
    const bool picture = !plan.preview.empty() || (!plan.result.empty() && file == nullptr);
    TimedSink timed(file.get());
    HashingSink sink(&timed);
    VoxelizeResult whole;
    const absl::StatusOr<EngineRun> run =
        engine.Run(input, request, arguments.repeat, job, sink, picture ? &whole : nullptr);
    if (!run.ok()) return run.status();
    VoxelizeReport report;
    report.input = input;
    report.header = sink.header();
    report.bytes = sink.bytes();
    absl::StatusOr<std::string> hash = sink.Digest();
    if (!hash.ok()) return hash.status();
    report.hash = *std::move(hash);
    const Stopwatch encode;
    if (file != nullptr) {
      if (absl::Status status = file->Commit(); !status.ok()) return status;
      report.files = OutputPaths(plan.result, request.targets.size());
    }
    if (absl::Status status = WritePictures(whole, plan, job, report); !status.ok()) return status;
    report.encode_ms = timed.milliseconds() + encode.Milliseconds();
    report.encoded = file != nullptr || picture;
    report.peak_bytes = run->server_peak_bytes.value_or(ProcessPeakBytes());
    bar.Clear();
    return PrintLine(arguments.json
                         ? VoxelizeJson(*run, report).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)
                         : VoxelizeTable(*run, report));
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    return absl::InternalError(error.what());
  }
}

int Voxelize(const VoxelizeArguments& arguments) {
  const auto wrong_option = [](const absl::Status& status) {
    PrintError("", status);
    return 2;
  };
  if (arguments.repeat < 1) return wrong_option(absl::InvalidArgumentError("--repeat: at least 1"));
  const absl::StatusOr<VoxelizeRequest> request = BuildRequest(arguments.request);
  if (!request.ok()) return wrong_option(request.status());
  const absl::StatusOr<std::vector<OutputPlan>> plans =
      PlanOutputs(arguments.inputs, arguments.output, arguments.preview, request->result);
  if (!plans.ok()) return wrong_option(plans.status());
  for (const OutputPlan& plan : *plans) {
    const std::string extension = FileExtension(plan.result);
    if (plan.result.empty() || CanHold(extension, request->result)) continue;
    return wrong_option(absl::InvalidArgumentError(absl::StrCat("--output: ", extension, " holds dense results; a ",
                                                                arguments.request.result, " one goes into .npz")));
  }
  const absl::StatusOr<std::unique_ptr<Engine>> engine = MakeEngine(arguments.server);
  if (!engine.ok()) return wrong_option(engine.status());

  int exit_code = 0;
  for (size_t i = 0; i < arguments.inputs.size(); ++i) {
    const absl::Status status = VoxelizeOne(**engine, arguments.inputs[i], (*plans)[i], *request, arguments);
    if (const int signal = InterruptSignal(); signal != 0) {
      PrintError(arguments.inputs[i], "stopped");
      return 128 + signal;
    }
    if (status.ok()) continue;
    PrintError(arguments.inputs[i], status);
    exit_code = 1;  // the other inputs still get their turn
  }
  return exit_code;
}

}  // namespace

void AddVoxelizeCommand(CLI::App& app, int& exit_code) {
  auto arguments = std::make_shared<VoxelizeArguments>();
  CLI::App* command = app.add_subcommand("voxelize", "Voxelize meshes");
  command->add_option("IN", arguments->inputs, "Mesh files: .glb, .gltf, .drc")->required()->type_name("");
  command
      ->add_option("-o,--output", arguments->output,
                   Wrapped("Where the result goes; the extension decides: .npy, .npz, .raw, .png (a picture). Several "
                           "targets into .npy or .raw: OUT.<index>.ext. With several IN a directory. Without it only "
                           "the summary is printed"))
      ->type_name("OUT")
      ->check(RefuseEmpty);
  command->add_option("--preview", arguments->preview, "Also write a picture: a shaded view and three slices")
      ->type_name("PNG")
      ->check(RefuseEmpty);
  command->add_flag("--json", arguments->json, "Print the summary as one JSON object a line");
  AddRequestFlags(*command, arguments->request);
  command->add_option("--server", arguments->server, "Voxelize on this server instead of in this process")
      ->group(kExecutionGroup)
      ->type_name("HOST:PORT")
      ->check(RefuseEmpty);
  command
      ->add_option("--repeat", arguments->repeat,
                   Wrapped("Run the pipeline N times on the loaded mesh and print medians"))
      ->group(kExecutionGroup)
      ->type_name("N");
  command->callback([arguments, &exit_code] { exit_code = Voxelize(*arguments); });
}

}  // namespace voxelpipe::cli
