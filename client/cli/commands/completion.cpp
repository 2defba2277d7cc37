#include "commands/commands.h"
#include "completion/scripts.h"
#include "engine/report.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {
namespace {

// `text` ends with a newline, and so does PrintLine.
int Print(std::string text) {
  text.pop_back();
  const absl::Status told = PrintLine(text);
  if (!told.ok()) PrintError("", told);
  return told.ok() ? 0 : 1;
}

}  // namespace

void AddCompletionCommand(CLI::App& app, int& exit_code) {
  auto shell = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("completion", "Print a script that completes command lines in a shell");
  command
      ->add_option("SHELL", *shell,
                   Wrapped("The shell. bash: source <(voxelpipe completion bash); zsh the same, after compinit; fish: "
                           "voxelpipe completion fish | source"))
      ->required()
      ->type_name("bash|zsh|fish")
      ->check(CLI::IsMember({"bash", "zsh", "fish"}));
  command->callback([&app, shell, &exit_code] {
    const ProgramModel program = ModelOf(app);
    exit_code = Print(*shell == "bash"  ? BashCompletion(program)
                      : *shell == "zsh" ? ZshCompletion(program)
                                        : FishCompletion(program));
  });
}

void AddManualCommand(CLI::App& app, int& exit_code) {
  CLI::App* command = app.add_subcommand("manual", "Print the manual page: voxelpipe manual | man -l -");
  command->callback([&app, &exit_code] { exit_code = Print(ManualPage(ModelOf(app), VOXELPIPE_VERSION)); });
}

}  // namespace voxelpipe::cli
