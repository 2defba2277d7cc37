#include <exception>
#include <new>

#include "absl/strings/str_cat.h"
#include "commands/commands.h"
#include "commands/progress_bar.h"
#include "encode/encode.h"
#include "encode/result_file.h"
#include "engine/engine.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "engine/run_to_files.h"
#include "engine/server_option.h"
#include "options/output_plan.h"
#include "options/request_flags.h"
#include "options/request_options.h"

namespace voxelpipe::cli {
namespace {

struct VoxelizeArguments {
  std::vector<std::string> inputs;
  std::string output, preview, server;
  RequestOptions request;
  int repeat = 1;
  bool json = false, allow_outside = false;
};

absl::Status VoxelizeOne(Engine& engine, const std::string& input, const OutputPlan& plan,
                         const VoxelizeRequest& request, const VoxelizeArguments& arguments) {
  ProgressBar bar;
  JobContext job([&bar](std::string_view stage, double fraction) { bar.Show(stage, fraction); });
  const CancelOnInterrupt cancel(job);
  try {
    absl::StatusOr<MeshInput> mesh = ReadMeshInput(input, {arguments.allow_outside, TexturesRead(request)}, job);
    if (!mesh.ok()) return mesh.status();
    VoxelizeReport report;
    report.input = input;
    const absl::StatusOr<EngineRun> run =
        RunToFiles(engine, *std::move(mesh), request, arguments.repeat, plan, job, report);
    if (!run.ok()) return run.status();
    bar.Clear();
    PrintWarnings(input, run->warnings);
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
      PrintError(arguments.inputs[i], StoppedReason(signal));
      return StoppedExitCode(signal);
    }
    if (status.ok()) continue;
    PrintError(arguments.inputs[i], status);
    exit_code = 1;  // continues with the other inputs
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
                   Wrapped("File of the result; the extension selects .npy, .npz, .raw or .png (a picture). Several "
                           "targets into .npy or .raw: OUT.<index>.ext. With several IN a directory. Without it only "
                           "the summary is printed"))
      ->type_name("OUT")
      ->check(RefuseEmpty);
  command->add_option("--preview", arguments->preview, "Also write a picture: a shaded view and three slices")
      ->type_name("PNG")
      ->check(RefuseEmpty);
  command->add_flag("--json", arguments->json, "Print the summary as one JSON object a line");
  AddAllowOutside(*command, arguments->allow_outside);
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
