// voxelpipe: voxelizes triangle meshes, in this process or on a server.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>

#include "absl/synchronization/mutex.h"
#include "base/threads.h"
#include "command_line/command.h"
#include "command_line/usage_error.h"
#include "commands/commands.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "options/server_access.h"
#include "options/together.h"

namespace {

// An empty value comes from an unset variable of a script: no option accepts it.
void RefuseEmptyValues(const voxelpipe::Program& app) {
  for (const voxelpipe::Command& command : app.commands()) {
    for (voxelpipe::Option option : command.options()) {
      if (option.max_values() > 0) option.Check(voxelpipe::cli::RefuseEmpty);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  using namespace voxelpipe::cli;
  int exit_code = 0;
  try {
    voxelpipe::Program app(
        "voxelpipe", "voxelpipe voxelizes triangle meshes (glTF 2.0, GLB, Draco), in this process or on a server.",
        VOXELPIPE_VERSION);
    app.RequireCommand();
    app.SetFooter(
        "Exit status: 0 done, 1 a job failed (one line on stderr says why), 2 an option is wrong, "
        "3 only permanent errors of a batch are left, which another run repeats.");
    AddVoxelizeCommand(app, exit_code);
    AddInfoCommand(app, exit_code);
    AddCompareCommand(app, exit_code);
    AddShadersCommand(app, exit_code);
    AddServerInfoCommand(app, exit_code);
    AddBatchCommand(app, exit_code);
    AddAggregateCommand(app, exit_code);
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
    if (const auto stop = app.Parse(WithTogetherValue({argv + 1, argv + argc})); stop) {
      if (stop->kind == voxelpipe::ParseStop::Kind::kAnswered) {
        std::fputs(stop->text.c_str(), stdout);
        return 0;
      }
      PrintError("", voxelpipe::UsageError(app, *stop));
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
