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
  const absl::StatusOr<Lines> lines = DescribeServer(arguments.server, arguments.json);
  const absl::Status status = lines.ok() ? PrintLines(*lines) : lines.status();
  if (!status.ok()) PrintError(arguments.server, status);
  return status.ok() ? 0 : 1;
}

}  // namespace

void AddServerInfoCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<ServerInfoArguments>();
  Command command = app.AddCommand("server-info", "Describe a server: version, devices, limits");
  command.AddOption("--server", arguments->server, "The server").Required().Type("HOST:PORT").Check(RefuseEmpty);
  command.AddFlag("--json", arguments->json, "Print one JSON object");
  command.SetCallback([arguments, &exit_code] { exit_code = ServerInfo(*arguments); });
}

}  // namespace voxelpipe::cli
