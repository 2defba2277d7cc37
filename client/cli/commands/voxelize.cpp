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
#include "request_text/request_options.h"

namespace voxelpipe::cli {
namespace {

struct VoxelizeArguments {
  std::vector<std::string> inputs;
  OutputNames names;
  std::string server, progress = "auto";
  RequestOptions request;
  int repeat = 1;
  bool json = false, recursive = false;
  MeshFlags mesh;
};

absl::Status VoxelizeOne(Engine& engine, const std::string& input, const OutputPlan& plan,
                         const VoxelizeRequest& request, const VoxelizeArguments& arguments, ProgressView& view) {
  JobContext job([&view](std::string_view stage, double fraction) { view.Show(stage, fraction); });
  const CancelOnInterrupt cancel(job);
  try {
    const absl::StatusOr<MeshFileType> type = MeshTypeOf(arguments.mesh.input_format, arguments.mesh.unit);
    if (!type.ok()) return type.status();
    absl::StatusOr<MeshInput> mesh =
        ReadMeshInput(input, {{arguments.mesh.allow_outside, TexturesRead(request)}, *type}, job);
    if (absl::IsNotFound(mesh.status())) {
      return absl::NotFoundError(absl::StrCat(std::string(mesh.status().message()), MissingFileHint(input)));
    }
    if (!mesh.ok()) return mesh.status();
    VoxelizeReport report;
    report.input = input;
    const absl::StatusOr<EngineRun> run = RunToFiles(engine, *std::move(mesh), request, arguments.repeat, plan, job,
                                                     report, [&view](uint64_t voxels) { view.set_voxels(voxels); });
    if (!run.ok()) return run.status();
    view.Clear();
    PrintWarnings(InputName(input), run->warnings);
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

int Voxelize(VoxelizeArguments arguments) {
  const auto wrong_option = [](const absl::Status& status) {
    PrintError("", status);
    return 2;
  };
  if (arguments.repeat < 1) return wrong_option(absl::InvalidArgumentError("--repeat: at least 1"));
  arguments.request.output_extension = ExtensionOf(arguments.names);
  const absl::StatusOr<VoxelizeRequest> request = BuildRequest(arguments.request);
  if (!request.ok()) return wrong_option(request.status());
  const absl::StatusOr<InputList> inputs = ExpandInputs(arguments.inputs, arguments.recursive);
  if (!inputs.ok()) return wrong_option(inputs.status());
  const absl::StatusOr<std::vector<OutputPlan>> plans =
      PlanOutputs(*inputs, arguments.names, request->result, request->targets.size());
  if (!plans.ok()) return wrong_option(plans.status());
  if (absl::Status s = CheckStreams(arguments); !s.ok()) return wrong_option(s);
  const absl::StatusOr<std::unique_ptr<Engine>> engine = MakeEngine(arguments.server);
  if (!engine.ok()) return wrong_option(engine.status());

  int exit_code = 0;
  ProgressView view(arguments.progress, inputs->files.size());
  for (size_t i = 0; i < inputs->files.size(); ++i) {
    const std::string& path = inputs->files[i].path;
    view.Begin(i + 1);
    const absl::Status status = VoxelizeOne(**engine, path, (*plans)[i], *request, arguments, view);
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
      .Required()
      .Type("");
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
