#include <exception>
#include <filesystem>
#include <new>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "clock.h"
#include "commands/commands.h"
#include "encode/encode.h"
#include "encode/png_preview.h"
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
  std::string result = "dense";
  std::string simd = "auto";
  int repeat = 1;
  bool json = false;
};

absl::Status CheckChoice(const char* option, const std::string& value, const std::vector<std::string>& known) {
  std::string list;
  for (const std::string& choice : known) {
    if (value == choice) return absl::OkStatus();
    absl::StrAppend(&list, list.empty() ? "" : ", ", choice);
  }
  return absl::InvalidArgumentError(absl::StrCat(option, ": unknown choice '", value, "'; known are ", list));
}

absl::Status WriteFiles(const EngineRun& run, const OutputPlan& plan, const JobContext& job, VoxelizeReport& report) {
  if (plan.result.empty() && plan.preview.empty()) return absl::OkStatus();
  const Stopwatch encode;
  for (const std::string& path : {plan.result, plan.preview}) {
    if (path.empty()) continue;
    job.Report("encode", path == plan.preview ? 0.5 : 0);
    const std::filesystem::path parent = std::filesystem::path(path).parent_path();
    std::error_code ignored;  // WriteResult names the path if it still is not there
    if (!parent.empty()) std::filesystem::create_directories(parent, ignored);
    if (absl::Status status = WriteResult(run.result, path, &job); !status.ok()) return status;
    for (std::string& file : OutputPaths(path, run.result.targets.size())) report.files.push_back(std::move(file));
  }
  report.encode_ms = encode.Milliseconds();
  report.encoded = true;
  return absl::OkStatus();
}

absl::Status VoxelizeOne(Engine& engine, const std::string& input, const OutputPlan& plan,
                         const VoxelizeRequest& request, const VoxelizeArguments& arguments) {
  ProgressBar bar;
  JobContext job([&bar](std::string_view stage, double fraction) { bar.Show(stage, fraction); });
  const CancelOnInterrupt cancel(job);
  try {
    const absl::StatusOr<EngineRun> run = engine.Run(input, request, arguments.repeat, job);
    if (!run.ok()) return run.status();
    VoxelizeReport report;
    report.input = input;
    absl::StatusOr<std::string> hash = HashResult(run->result);
    if (!hash.ok()) return hash.status();
    report.hash = *std::move(hash);
    if (absl::Status status = WriteFiles(*run, plan, job, report); !status.ok()) return status;
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
  if (absl::Status s = CheckChoice("--result", arguments.result, {"dense"}); !s.ok()) return wrong_option(s);
  if (absl::Status s = CheckChoice("--simd", arguments.simd, {"auto", "scalar"}); !s.ok()) return wrong_option(s);
  if (arguments.repeat < 1) return wrong_option(absl::InvalidArgumentError("--repeat: at least 1"));
  const absl::StatusOr<VoxelizeRequest> request = BuildRequest(arguments.request);
  if (!request.ok()) return wrong_option(request.status());
  const absl::StatusOr<std::vector<OutputPlan>> plans =
      PlanOutputs(arguments.inputs, arguments.output, arguments.preview);
  if (!plans.ok()) return wrong_option(plans.status());
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
  add("--fill", request.fill, "none|parity", "Whether the inside is filled (default none)");
  add("--shader", request.shader, "NAME[:k=v,...]",
      "The fragment shader of every target that names none. A vector's numbers are separated by '/', as in "
      "constant:value=0.5/0.2/1. 'voxelpipe shaders' lists them");
  add("--vertex-shader", request.vertex_shader, "NAME[:k=v,...]", "The vertex shader (default identity)");
  add("--target", request.targets, "FORMAT[xC]:BLEND[:k=v,...]",
      "A render target; may be given several times. FORMAT bit or f32, C = 1 to 4 components. BLEND or, replace for "
      "bit; replace, min, max, add for f32. k is shader, quantum (add), clear, fill, or a parameter of the shader. "
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
  add("--result", arguments.result, "dense", "Kind of result");
  add("--backend", arguments.request.backend, "auto|cpu|cuda", "What does the work (default auto)");
  add("--threads", arguments.request.threads, "N", "Threads of the CPU backend (default 0: all cores)");
  add("--simd", arguments.simd, "auto|scalar", "Instruction set of the CPU backend (default auto)");
  add("--repeat", arguments.repeat, "N", "Run the pipeline N times on the loaded mesh and print medians");
}

}  // namespace

void AddVoxelizeCommand(CLI::App& app, int& exit_code) {
  auto arguments = std::make_shared<VoxelizeArguments>();
  CLI::App* command = app.add_subcommand("voxelize", "Voxelize meshes");
  command->add_option("IN", arguments->inputs, "Mesh files: .glb, .gltf, .drc")->required()->type_name("");
  command
      ->add_option("-o,--output", arguments->output,
                   Wrapped("Where the result goes; the extension decides: .npy, .raw, .png (a picture). Several "
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
