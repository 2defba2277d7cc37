#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "batch/aggregate.h"
#include "commands/commands.h"
#include "engine/report.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {
namespace {

struct AggregateArguments {
  std::vector<std::string> reports;
  std::string retry_list;
  bool json = false;
};

int RunAggregate(const AggregateArguments& arguments) {
  const absl::StatusOr<Aggregate> all = AggregateReports(arguments.reports);
  if (!all.ok()) {
    PrintError("aggregate", all.status());
    return 2;
  }
  absl::Status status = arguments.json ? PrintLine(JsonText(AggregateJson(*all))) : PrintLines(AggregateTable(*all));
  if (status.ok() && !arguments.retry_list.empty()) status = WriteRetryList(*all, arguments.retry_list);
  if (!status.ok()) PrintError("aggregate", status);
  return status.ok() ? all->exit_code() : 1;
}

}  // namespace

void AddAggregateCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<AggregateArguments>();
  Command command = app.AddCommand("aggregate", "Sum up the reports of the shards of a batch: done, failed, missing");
  command
      .AddOption("REPORT", arguments->reports,
                 Wrapped("What batch --report wrote, of one list; of an item in several, the last report counts"))
      .Required()
      .Type("")
      .Check(RefuseEmpty);
  command.AddFlag("--json", arguments->json, "Print one JSON object, with all items that failed or are missing");
  command.AddOption("--retry-list", arguments->retry_list, "Write the lines of the list that are left, for another run")
      .Type("FILE")
      .Check(RefuseEmpty);
  command.SetFooter(
      "Exit status: 0 all is done, 1 items are missing or may pass in another run, 2 a report is wrong, 3 only "
      "permanent "
      "errors of items are left.");
  command.SetCallback([arguments, &exit_code] { exit_code = RunAggregate(*arguments); });
}

}  // namespace voxelpipe::cli
