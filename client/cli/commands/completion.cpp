#include "absl/strings/str_split.h"
#include "commands/commands.h"
#include "completion/scripts.h"
#include "engine/report.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {
namespace {

// `text` ends with a newline.
int Print(std::string text) {
  text.pop_back();
  const absl::Status told = PrintLines(absl::StrSplit(text, '\n'));
  if (!told.ok()) PrintError("", told);
  return told.ok() ? 0 : 1;
}

}  // namespace

void AddCompletionCommand(Command& app, int& exit_code) {
  auto shell = std::make_shared<std::string>();
  Command command = app.AddCommand("completion", "Print a script that completes command lines in a shell");
  command
      .AddOption("SHELL", *shell,
                 Wrapped("The shell. bash: source <(voxelpipe completion bash); zsh the same, after compinit; fish: "
                         "voxelpipe completion fish | source"))
      .Required()
      .Type("bash|zsh|fish")
      .Choices({"bash", "zsh", "fish"});
  command.SetCallback([&app, shell, &exit_code] {
    const ProgramModel program = ModelOf(app);
    exit_code = Print(*shell == "bash"  ? BashCompletion(program)
                      : *shell == "zsh" ? ZshCompletion(program)
                                        : FishCompletion(program));
  });
}

void AddManualCommand(Command& app, int& exit_code) {
  Command command = app.AddCommand("manual", "Print the manual page: voxelpipe manual | man -l -");
  command.SetCallback([&app, &exit_code] { exit_code = Print(ManualPage(ModelOf(app), VOXELPIPE_VERSION)); });
}

}  // namespace voxelpipe::cli
