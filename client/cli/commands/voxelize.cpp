#include <algorithm>
#include <cstdio>
#include <exception>
#include <new>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "commands/commands.h"
#include "commands/progress_view.h"
#include "encode/encode.h"
#include "encode/format_registry.h"
#include "engine/engine.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "engine/run_to_files.h"
#include "engine/server_option.h"
#include "options/mesh_flags.h"
#include "options/missing_file.h"
#include "options/output_plan.h"
#include "options/request_flags.h"
#include "options/standard_streams.h"
#include "options/together.h"
#include "request_text/request_options.h"

namespace voxelpipe::cli {
namespace {

struct VoxelizeArguments {
  std::vector<std::string> inputs;
  OutputNames names;
  std::string together;  // a list file, kTogetherInputs, or empty
  std::string server, progress = "auto";
  RequestOptions request;
  int repeat = 1;
  bool json = false, recursive = false;
  MeshFlags mesh;
};

// The files of one run: one, or those of several meshes on one grid.
struct RunInputs {
  std::string name;  // for reports
  Together meshes;   // `placed` empty: one file, as it is
};

absl::StatusOr<MeshInputs> ReadInputs(RunInputs inputs, const MeshReading& reading, const JobContext& job) {
  MeshInputs read;
  for (const std::string& path : inputs.meshes.paths) {
    absl::StatusOr<MeshInput> mesh = ReadMeshInput(path, reading, job);
    const bool several = !inputs.meshes.placed.empty();
    if (!mesh.ok()) {
      const std::string hint = absl::IsNotFound(mesh.status()) ? MissingFileHint(path) : "";
      return absl::Status(mesh.status().code(), absl::StrCat(several ? absl::StrCat(InputName(path), ": ") : "",
                                                             std::string(mesh.status().message()), hint));
    }
    read.files.push_back(*std::move(mesh));
  }
  read.placed = std::move(inputs.meshes.placed);
  return read;
}

absl::Status VoxelizeOne(Engine& engine, const RunInputs& inputs, const OutputPlan& plan,
                         const VoxelizeRequest& request, const VoxelizeArguments& arguments, ProgressView& view) {
  JobContext job([&view](std::string_view stage, double fraction) { view.Show(stage, fraction); });
  const CancelOnInterrupt cancel(job);
  try {
    const absl::StatusOr<MeshFileType> type = MeshTypeOf(arguments.mesh.input_format, arguments.mesh.unit);
    if (!type.ok()) return type.status();
    absl::StatusOr<MeshInputs> meshes =
        ReadInputs(inputs, {{arguments.mesh.allow_outside, TexturesRead(request)}, *type}, job);
    if (!meshes.ok()) return meshes.status();
    VoxelizeReport report;
    report.input = inputs.name;
    const absl::StatusOr<EngineRun> run = RunToFiles(engine, *std::move(meshes), request, arguments.repeat, plan, job,
                                                     report, [&view](uint64_t voxels) { view.set_voxels(voxels); });
    if (!run.ok()) return run.status();
    view.Clear();
    PrintWarnings(InputName(inputs.name), run->warnings);
    const Lines summary = arguments.json ? Lines{JsonText(VoxelizeJson(*run, report))} : VoxelizeTable(*run, report);
    if (plan.standard_output.empty()) return PrintLines(summary);
    for (const std::string& line : summary) WriteLine(stderr, line);  // the result is on standard output
    return absl::OkStatus();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    return absl::InternalError(error.what());
  }
}

// Standard input is read once, and a terminal is no place for a mesh or a result.
absl::Status CheckStreams(const VoxelizeArguments& arguments) {
  if (absl::Status s = CheckInputStream(arguments.inputs); !s.ok()) return s;
  return IsStandardStream(arguments.names.output) ? CheckStandardOutput() : absl::OkStatus();
}

bool TakesAFileEach(const OutputFormat& format) {
  return format.targets == TargetPlaces::kFileEach;
}

// The extension of the files that results go to; of the picture where there is nothing else.
std::string ExtensionOf(const OutputNames& names) {
  const std::string extension = FileExtension(names.output.empty() ? names.preview : names.output);
  return extension.empty() ? FileExtension("x." + names.format) : extension;
}

// What the command runs, one after the other, and the outputs of each.
struct Runs {
  std::vector<RunInputs> inputs;
  std::vector<OutputPlan> plans;
};

absl::StatusOr<Together> ReadMeshes(const VoxelizeArguments& arguments) {
  if (arguments.together != kTogetherInputs) {
    if (FileExtension(arguments.together) != ".json") {
      return absl::InvalidArgumentError(absl::StrCat("--together: '", arguments.together, "' is no LIST.json"));
    }
    if (!arguments.inputs.empty()) {
      return absl::InvalidArgumentError("--together LIST.json names the meshes itself: give no IN beside it");
    }
    return ReadTogether(arguments.together);
  }
  const absl::StatusOr<InputList> inputs = ExpandInputs(arguments.inputs, arguments.recursive);
  if (!inputs.ok()) return inputs.status();
  std::vector<std::string> paths;
  for (const InputFile& file : inputs->files) paths.push_back(file.path);
  return TogetherOf(paths);
}

absl::StatusOr<Runs> PlanRuns(const VoxelizeArguments& arguments, const VoxelizeRequest& request) {
  const auto plan = [&](const InputList& inputs) {
    return PlanOutputs(inputs, arguments.names, request);
  };
  Runs runs;
  if (arguments.together.empty()) {
    const absl::StatusOr<InputList> inputs = ExpandInputs(arguments.inputs, arguments.recursive);
    if (!inputs.ok()) return inputs.status();
    absl::StatusOr<std::vector<OutputPlan>> plans = plan(*inputs);
    if (!plans.ok()) return plans.status();
    for (const InputFile& file : inputs->files) runs.inputs.push_back({file.path, {{file.path}, {}}});
    runs.plans = *std::move(plans);
    return runs;
  }
  absl::StatusOr<Together> together = ReadMeshes(arguments);
  if (!together.ok()) return together.status();
  for (const std::string& path : together->paths) {  // the output is none of the inputs
    const absl::StatusOr<std::vector<OutputPlan>> plans = plan({{{path, "together"}}, false});
    if (!plans.ok()) return plans.status();
    runs.plans = *plans;
  }
  std::string name = arguments.together == kTogetherInputs ? NameOf(*together) : arguments.together;
  runs.inputs.push_back({std::move(name), *std::move(together)});
  return runs;
}

int Voxelize(VoxelizeArguments arguments) {
  const auto wrong_option = [](const absl::Status& status) {
    PrintError("", status);
    return 2;
  };
  if (arguments.inputs.empty() && (arguments.together.empty() || arguments.together == kTogetherInputs)) {
    return wrong_option(absl::InvalidArgumentError("IN is required; see 'voxelpipe voxelize --help'"));
  }
  if (arguments.repeat < 1) return wrong_option(absl::InvalidArgumentError("--repeat: at least 1"));
  arguments.request.output_extension = ExtensionOf(arguments.names);
  const absl::StatusOr<VoxelizeRequest> request = BuildRequest(arguments.request);
  if (!request.ok()) return wrong_option(request.status());
  const absl::StatusOr<Runs> runs = PlanRuns(arguments, *request);
  if (!runs.ok()) return wrong_option(runs.status());
  if (absl::Status s = CheckStreams(arguments); !s.ok()) return wrong_option(s);
  const absl::StatusOr<std::unique_ptr<Engine>> engine = MakeEngine(arguments.server);
  if (!engine.ok()) return wrong_option(engine.status());

  int exit_code = 0;
  ProgressView view(arguments.progress, runs->inputs.size());
  for (size_t i = 0; i < runs->inputs.size(); ++i) {
    const std::string& path = runs->inputs[i].name;
    view.Begin(i + 1);
    const absl::Status status = VoxelizeOne(**engine, runs->inputs[i], runs->plans[i], *request, arguments, view);
    view.End(!status.ok());
    view.Clear();
    if (const int signal = InterruptSignal(); signal != 0) {
      PrintError(InputName(path), StoppedReason(signal));
      return StoppedExitCode(signal);
    }
    if (status.ok()) continue;
    PrintError(InputName(path), status);
    exit_code = 1;  // continues with the other inputs
  }
  view.Finish();
  return exit_code;
}

}  // namespace

void AddVoxelizeCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<VoxelizeArguments>();
  Command command = app.AddCommand("voxelize", "Voxelize meshes");
  command
      .AddOption("IN", arguments->inputs,
                 Wrapped("Mesh files: .glb, .gltf, .drc, .stl, .ply, .off, .obj, .3mf; - is standard input. Also "
                         "directories, for the meshes in "
                         "them, and quoted patterns of *, ? and ** (any directories), as in 'meshes/**/*.glb'"))
      .Type("");
  command
      .AddOption("--together", arguments->together,
                 Wrapped("Voxelize all meshes on one grid: those of IN where they are, or those of LIST.json, "
                         "{\"meshes\": [{\"input\", \"matrix\", \"name\", \"label\", \"priority\", \"motion\"}]}"))
      .Type("[LIST.json]");
  command.AddFlag("--recursive", arguments->recursive, "Also the meshes in the directories below those of IN");
  command
      .AddOption("-o,--output", arguments->names.output,
                 Wrapped(absl::StrCat(
                     "File of the result; the extension selects the format: ", ListFormats(true),
                     " (a picture). Several targets into ", ListFormats(true, &TakesAFileEach),
                     ": OUT.<index>.ext. With several IN a directory, which keeps the folders below a directory or "
                     "pattern. - is standard output, with --format; the summary then goes to standard error. "
                     "Without it only the summary is printed")))
      .Type("OUT")
      .Check(RefuseEmpty);
  command
      .AddOption("--format", arguments->names.format,
                 Wrapped("Of the result on standard output, or in a directory (default npy; npz for lists)"))
      .Type(FormatChoices())
      .Check([](const std::string& name) { return std::string(WhyNotBuilt(absl::StrCat(".", name))); })
      .Choices(FormatNames());
  command.AddOption("--preview", arguments->names.preview, "Also write a picture: a shaded view and three slices")
      .Type("PNG")
      .Check(RefuseEmpty);
  command
      .AddOption("--view", arguments->names.view,
                 Wrapped("Camera of pictures: iso (default), front, back, left, right, top, bottom, or "
                         "AZIMUTH,ELEVATION in degrees, from +Z towards +X and above the horizon"))
      .Type("VIEW")
      .Check(RefuseEmpty);
  command.AddFlag("--json", arguments->json, "Print the summary as one JSON object a line");
  AddProgressFlag(command, arguments->progress, kExecutionGroup);
  AddMeshFlags(command, arguments->mesh);
  AddRequestFlags(command, arguments->request);
  command.AddOption("--server", arguments->server, "Voxelize on this server instead of in this process")
      .Group(kExecutionGroup)
      .Type("HOST:PORT")
      .Check(RefuseEmpty);
  command
      .AddOption("--repeat", arguments->repeat,
                 Wrapped("Run the pipeline N times on the loaded mesh and print medians"))
      .Group(kExecutionGroup)
      .Type("N");
  command.SetCallback([arguments, &exit_code] { exit_code = Voxelize(*arguments); });
}

}  // namespace voxelpipe::cli
