#include "commands/commands.h"
#include "engine/report.h"
#include "engine/server_option.h"

namespace voxelpipe::cli {
namespace {

struct ServerInfoArguments {
  std::string server;
  bool json = false;
};

int ServerInfo(const ServerInfoArguments& arguments) {
  if (const absl::Status status = CheckServerOption(arguments.server); !status.ok()) {
    PrintError("", status);
    return 2;
  }
  const absl::StatusOr<std::string> text = DescribeServer(arguments.server, arguments.json);
  const absl::Status status = text.ok() ? PrintLine(*text) : text.status();
  if (!status.ok()) PrintError(arguments.server, status);
  return status.ok() ? 0 : 1;
}

}  // namespace

void AddServerInfoCommand(CLI::App& app, int& exit_code) {
  auto arguments = std::make_shared<ServerInfoArguments>();
  CLI::App* command = app.add_subcommand("server-info", "Describe a server: version, devices, limits");
  command->add_option("--server", arguments->server, "The server")
      ->required()
      ->type_name("HOST:PORT")
      ->check(RefuseEmpty);
  command->add_flag("--json", arguments->json, "Print one JSON object");
  command->callback([arguments, &exit_code] { exit_code = ServerInfo(*arguments); });
}

}  // namespace voxelpipe::cli
