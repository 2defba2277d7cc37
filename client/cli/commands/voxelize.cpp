#include <exception>
#include <filesystem>
#include <new>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
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

// Breaks a description so that it fits beside the option names on a terminal.
std::string Wrapped(const std::string& text) {
  constexpr size_t kColumns = 78;
  std::string wrapped;
  size_t column = 0;
  for (const std::string& word : std::vector<std::string>(absl::StrSplit(text, ' '))) {
    if (column > 0 && column + 1 + word.size() > kColumns) {
      wrapped += '\n';
      column = 0;
    } else if (column > 0) {
      wrapped += ' ';
      ++column;
    }
    wrapped += word;
    column += word.size();
  }
  return wrapped;
}

void AddGridOptions(CLI::App& command, RequestOptions& request) {
  const std::string group = "Grid";
  const auto add = [&](const char* name, auto& value, const char* type, const char* text) {
    command.add_option(name, value, Wrapped(text))->group(group)->type_name(type);
  };
  add("--resolution", request.resolution, "N", "Voxels along the longest extent (default 128)");
  add("--voxel-size", request.voxel_size, "H[,HY,HZ]", "Voxel size, one for all axes or three, in the mesh's units");
  add("--dims", request.dims, "X,Y,Z", "Dims of a grid that --dims, --origin and --voxel-size give together");
  add("--origin", request.origin, "X,Y,Z", "Origin of that grid: the corner of its first voxel");
  add("--fit", request.fit, "tight|cube",
      "tight (default): as many voxels an axis as the mesh needs; cube: N x N x N, shorter axes centred");
  add("--padding", request.padding, "P", "Empty voxels on every side (default 0)");
}

void AddShadingOptions(CLI::App& command, RequestOptions& request) {
  const std::string group = "Voxels and values";
  const auto add = [&](const char* name, auto& value, const char* type, const char* text) {
    return command.add_option(name, value, Wrapped(text))->group(group)->type_name(type);
  };
  add("--coverage", request.coverage, "conservative|thin|center",
      "Which voxels a triangle covers (default conservative: all it touches)");
  add("--fill", request.fill, "none|parity|flood",
      "Whether the inside is filled (default none): parity by crossings along x, flood by what a walk from outside "
      "does "
      "not reach");
  add("--shader", request.shader, "NAME[:k=v,...]",
      "The fragment shader of every target that names none. A vector's numbers are separated by '/', as in "
      "constant:value=0.5/0.2/1. 'voxelpipe shaders' lists them");
  add("--vertex-shader", request.vertex_shader, "NAME[:k=v,...]", "The vertex shader (default identity)");
  add("--target", request.targets, "FORMAT[xC]:BLEND[:k=v,...]",
      "A render target; may be given several times. FORMAT bit, u8, u16, u32, f16 or f32, C = 1 to 4 components. BLEND "
      "or, and, replace, first, count for bit; also min, max, add, average for integers; all but or, and for floats. k "
      "is "
      "shader, scale (integers), quantum (add and average of floats), clear, fill, or a parameter of the shader. "
      "Default: bit:or with shader occupancy; with another --shader f32xC:replace, C as many as the shader gives")
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  add("--layout", request.layout, "interleaved|planar", "Order of components (default interleaved)");
}

void AddExecutionOptions(CLI::App& command, VoxelizeArguments& arguments) {
  const std::string group = "Execution";
  const auto add = [&](const char* name, auto& value, const char* type, const char* text) {
    return command.add_option(name, value, Wrapped(text))->group(group)->type_name(type);
  };
  add("--server", arguments.server, "HOST:PORT", "Voxelize on this server instead of in this process")
      ->check(RefuseEmpty);
  add("--result", arguments.request.result, "dense|sparse|buckets",
      "Kind of result (default dense): every voxel; the occupied bricks; or all fragments of each voxel");
  add("--backend", arguments.request.backend, "auto|cpu|cuda", "What does the work (default auto)");
  add("--threads", arguments.request.threads, "N", "Threads of the CPU backend (default 0: all cores)");
  add("--simd", arguments.request.simd, "auto|avx512|avx2|scalar", "Instruction set of the CPU backend (default auto)");
  add("--repeat", arguments.repeat, "N", "Run the pipeline N times on the loaded mesh and print medians");
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
  AddGridOptions(*command, arguments->request);
  AddShadingOptions(*command, arguments->request);
  AddExecutionOptions(*command, *arguments);
  command->callback([arguments, &exit_code] { exit_code = Voxelize(*arguments); });
}

}  // namespace voxelpipe::cli
