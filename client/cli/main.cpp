// voxelpipe: voxelizes triangle meshes, in this process or on a server.
#include <CLI/CLI.hpp>
#include <cstdlib>
#include <exception>
#include <new>

#include "absl/synchronization/mutex.h"
#include "base/threads.h"
#include "command_line/usage_error.h"
#include "commands/commands.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "options/server_access.h"

namespace {

// An empty value comes from an unset variable of a script: no option accepts it.
void RefuseEmptyValues(CLI::App& app) {
  for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; })) {
    for (CLI::Option* option : command->get_options()) {
      if (option->get_expected_max() > 0) option->check(voxelpipe::cli::RefuseEmpty);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  using namespace voxelpipe::cli;
  int exit_code = 0;
  try {
    CLI::App app{"voxelpipe voxelizes triangle meshes (glTF 2.0, GLB, Draco), in this process or on a server."};
    app.name("voxelpipe");
    app.require_subcommand(1);
    app.set_version_flag("--version", VOXELPIPE_VERSION);
    app.footer(
        "Exit status: 0 done, 1 a job failed (one line on stderr says why), 2 an option is wrong, "
        "3 only permanent errors of a batch are left, which another run repeats.");
    AddVoxelizeCommand(app, exit_code);
    AddInfoCommand(app, exit_code);
    AddCompareCommand(app, exit_code);
    AddShadersCommand(app, exit_code);
    AddServerInfoCommand(app, exit_code);
    AddBatchCommand(app, exit_code);
    AddBenchCommand(app, exit_code);
    AddCompletionCommand(app, exit_code);
    AddManualCommand(app, exit_code);
    AddServerAccessFlags(app);
    RefuseEmptyValues(app);
    // gRPC's own log lines repeat our error line as C structures; set the variable to see them.
    setenv("GRPC_VERBOSITY", "NONE", 0);
    // gRPC uses Abseil's locks, which in debug builds keep a graph of all locks behind one lock.
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
    HandleInterrupts();
    voxelpipe::LimitThreadsToCpus();
    try {
      app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
      if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
      PrintError("", voxelpipe::UsageError(app, error));
      return 2;
    }
  } catch (const std::bad_alloc&) {
    PrintError("", "out of memory");
    return 1;
  } catch (const std::exception& error) {
    PrintError("", error.what());
    return 1;
  }
  return exit_code;
}
