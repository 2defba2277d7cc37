#include <algorithm>
#include <chrono>
#include <future>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "base/machine.h"
#include "base/text.h"
#include "batch/batch_report.h"
#include "batch/batch_run.h"
#include "batch/manifest.h"
#include "commands/commands.h"
#include "commands/progress_view.h"
#include "encode/format_registry.h"
#include "encode/preview/preview_view.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "engine/server_option.h"
#include "options/mesh_flags.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {
namespace {

struct BatchArguments {
  BatchPlan plan;
  ManifestDefaults defaults;
  std::optional<std::string> shard;
  std::optional<int> jobs;
  std::optional<int64_t> deadline_ms;
  int64_t busy_timeout_s = 600, lost_timeout_s = 30;
  std::string report, progress = "auto";
  bool json = false;
};

// All was done that can be: no other run will do the rest.
constexpr int kOnlyPermanentErrors = 3;

// Reads the options. Every error is a usage error.
absl::Status Prepare(BatchArguments& arguments) {
  BatchPlan& plan = arguments.plan;
  constexpr int kMaxJobs = 1024;
  if (arguments.jobs && (*arguments.jobs < 1 || *arguments.jobs > kMaxJobs)) {
    return absl::InvalidArgumentError(absl::StrCat("--jobs: 1 to ", kMaxJobs));
  }
  if (plan.retries < 0) return absl::InvalidArgumentError("--retries: at least 0");
  if (arguments.busy_timeout_s < 0) return absl::InvalidArgumentError("--busy-timeout: at least 0 seconds");
  if (arguments.lost_timeout_s < 0) return absl::InvalidArgumentError("--lost-timeout: at least 0 seconds");
  if (arguments.deadline_ms && *arguments.deadline_ms < 1)
    return absl::InvalidArgumentError("--deadline-ms: at least 1");
  if (!plan.servers.empty()) {
    if (absl::Status status = CheckServerOption(plan.servers.front()); !status.ok()) return status;
  }
  plan.allow_outside = arguments.defaults.mesh.allow_outside;
  // Errors in the defaults are not those of the manifest.
  if (const auto request = BuildRequest(arguments.defaults.request); !request.ok()) return request.status();
  if (const auto& view = arguments.defaults.view; view && !ParseView(*view).ok()) {
    return absl::InvalidArgumentError(absl::StrCat("--view: ", std::string(ParseView(*view).status().message())));
  }
  if (arguments.shard) {
    const absl::StatusOr<Shard> shard = ParseShard(*arguments.shard);
    if (!shard.ok()) return shard.status();
    plan.shard = *shard;
  }
  const int cores = CpuCount();
  plan.jobs = arguments.jobs.value_or(plan.servers.empty() ? std::min(4, cores) : 4 * int(plan.servers.size()));
  plan.busy_timeout = std::chrono::seconds(arguments.busy_timeout_s);
  plan.lost_timeout = std::chrono::seconds(arguments.lost_timeout_s);
  if (arguments.deadline_ms) plan.deadline = std::chrono::milliseconds(*arguments.deadline_ms);
  return absl::OkStatus();
}

// How many items of the manifest the shard has.
uint64_t ItemsOf(const Shard& shard, uint64_t items) {
  const uint64_t first = shard.index % shard.count;
  return items > first ? (items - first - 1) / shard.count + 1 : 0;
}

absl::StatusOr<BatchResult> Run(const BatchPlan& plan, ManifestReader& list, const std::string& progress,
                                const std::string& report_path) {
  std::optional<ReportWriter> report;
  if (!report_path.empty()) {
    absl::StatusOr<ReportWriter> created = ReportWriter::Create(report_path, plan);
    if (!created.ok()) return created.status();
    report.emplace(*std::move(created));
  }
  // One pass over the whole list, much faster than its items: for the time left, and for what is left after a stop.
  std::future<absl::StatusOr<ManifestFacts>> scan = std::async(std::launch::async, [&list] { return list.Scan(); });
  std::optional<absl::StatusOr<ManifestFacts>> facts;
  ProgressView view(progress, 0);
  const auto take_facts = [&] {
    facts = scan.get();
    if (facts->ok()) view.set_items(ItemsOf(plan.shard, (*facts)->items));
  };
  BatchHooks hooks;
  hooks.next_item = [&list] { return list.Next(); };
  // CheckServerOption has passed: an engine can be made. No retries: the item may run on another server at once.
  hooks.make_engine = [](const std::string& server) { return *MakeEngine(server, /*retries=*/0); };
  hooks.stop_signal = &InterruptSignal;
  hooks.retry_delay = &RetryDelayOf;
  hooks.could_not_connect = &CouldNotConnect;
  hooks.on_gone = [&](const absl::Status& status) {
    PrintError("batch", absl::StrCat("no server can be reached, waiting up to ", plan.lost_timeout.count() / 1000,
                                     " s for one: ", ErrorText(status)));
  };
  hooks.on_progress = [&](size_t ended, size_t failed) {
    if (!facts && scan.wait_for(std::chrono::seconds(0)) == std::future_status::ready) take_facts();
    view.ShowEnded(ended, failed);
  };
  hooks.on_ended = [&](const BatchItem& item, const ItemReport& ended) {
    if (report) report->Add(item, ended);
    if (ended.status != ItemStatus::kFailed) return;
    PrintError(absl::StrCat(plan.manifest, ":", item.line, ": ", item.id), ended.error);
  };
  absl::StatusOr<BatchResult> result = RunBatch(plan, hooks);
  if (!facts) take_facts();
  if (!result.ok()) return result;
  view.ShowEnded(result->totals.ended(), result->totals.failed);
  view.Finish();
  if (!facts->ok()) facts = list.Scan();  // the file may be there again
  if (!facts->ok()) {
    result->report = facts->status();
    PrintError("batch", absl::StrCat(ErrorText(result->report), "; there is no report"));
    return result;
  }
  BatchTotals& totals = result->totals;
  totals.items = std::max<size_t>(totals.items, ItemsOf(plan.shard, (*facts)->items));
  totals.left = totals.items - totals.ended();
  if (report) {
    result->report = report->Finish(*result, **facts);
    if (!result->report.ok()) PrintError("batch", result->report);
  }
  return result;
}

int Batch(BatchArguments& arguments) {
  const BatchPlan& plan = arguments.plan;
  // A list that cannot be read for the moment is no mistake of the user's.
  const auto exit_code_of = [](const absl::Status& status) { return absl::IsDataLoss(status) ? 1 : 2; };
  const auto usage_error = [&](const absl::Status& status) {
    PrintError("", status);
    return exit_code_of(status);
  };
  if (const absl::Status status = Prepare(arguments); !status.ok()) return usage_error(status);
  absl::StatusOr<ManifestReader> list = ManifestReader::Open(plan.manifest, arguments.defaults, plan.shard);
  if (!list.ok()) return usage_error(list.status());
  const absl::StatusOr<BatchResult> result = Run(plan, *list, arguments.progress, arguments.report);
  if (!result.ok()) {
    PrintError("batch", result.status());
    return 1;
  }
  const BatchTotals& totals = result->totals;
  PrintWarnings(plan.manifest, result->warnings);
  const absl::Status told = PrintLine(arguments.json ? JsonText(TotalsJson(*result)) : TotalsLine(*result));
  if (!told.ok()) PrintError("batch", told);
  if (const int signal = InterruptSignal(); signal != 0) {
    PrintError("batch", absl::StrCat(StoppedReason(signal), ", ", totals.left, " items are left"));
    return StoppedExitCode(signal);
  }
  for (const auto& [error, exit_code] :
       {std::pair(result->list, exit_code_of(result->list)), std::pair(result->gone, 1)}) {
    if (error.ok()) continue;
    PrintError("batch", absl::StrCat(ErrorText(error), "; ", totals.left, " items are left"));
    return exit_code;
  }
  if (!told.ok() || !result->report.ok() || totals.left > 0 || totals.failed > totals.permanent) return 1;
  return totals.failed == 0 ? 0 : kOnlyPermanentErrors;
}

}  // namespace

void AddBatchCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<BatchArguments>();
  BatchPlan& plan = arguments->plan;
  Command command =
      app.AddCommand("batch", "Voxelize the meshes of a list; a further run continues where the last one stopped");
  const std::string group = "Batch";
  const auto add = [&](const char* name, ValueRef value, const std::string& type, const char* text) {
    return command.AddOption(name, value, Wrapped(text)).Group(group).Type(type);
  };
  command
      .AddOption("MANIFEST", plan.manifest,
                 Wrapped("JSON lines, an object a mesh: \"input\" (or \"meshes\": several on one grid), optionally "
                         "\"id\", \"output\", \"format\", "
                         "\"preview\", \"view\" and any option below without its dashes"))
      .Required()
      .Type("")
      .Check(RefuseEmpty);
  add("--output-dir", plan.output_dir, "D", "Where the results go").Required().Check(RefuseEmpty);
  add("--format", arguments->defaults.format, FormatChoices(), "Of outputs that name none (default npy; npz for lists)")
      .Check([](const std::string& name) { return std::string(WhyNotBuilt(absl::StrCat(".", name))); })
      .Choices(FormatNames());
  add("--view", arguments->defaults.view, "VIEW",
      "Camera of pictures: iso (default), front, back, left, right, top, bottom, or AZIMUTH,ELEVATION in degrees")
      .Check(RefuseEmpty);
  add("--jobs", arguments->jobs, "N", "Meshes at the same time (default: up to 4; with servers 4 for each)");
  add("--shard", arguments->shard, "auto|i/n",
      "Only every n-th mesh, from the i-th on; i from 0 to n-1, n/n is 0/n. auto: this task of an array job of Slurm, "
      "or "
      "this pod of an Indexed Job of Kubernetes with VOXELPIPE_SHARDS pods");
  command
      .AddOption("--server", plan.servers,
                 Wrapped("Servers to distribute the meshes to, with commas or several --server"))
      .Group(group)
      .Type("HOST:PORT")
      .Delimiter(',')
      .Repeatable()
      .Check([](const std::string& server) { return server.empty() ? "--server: must not be empty" : ""; });
  add("--retries", plan.retries, "R", "Further attempts for a mesh whose server failed or timed out (default 5)");
  add("--busy-timeout", arguments->busy_timeout_s, "S", "Seconds to wait for overloaded servers (default 600)");
  add("--lost-timeout", arguments->lost_timeout_s, "S",
      "Seconds to wait for any server once none can be reached; then the run ends (default 30)");
  add("--deadline-ms", arguments->deadline_ms, "T", "Longest time of an attempt (default: none)");
  command.AddFlag("--fail-fast", plan.fail_fast, "Start no mesh after one has failed").Group(group);
  add("--report", arguments->report, "FILE", "Write the outcome of each mesh, as JSON").Check(RefuseEmpty);
  command.AddFlag("--json", arguments->json, "Print the totals as one JSON object").Group(group);
  AddProgressFlag(command, arguments->progress, group);
  AddMeshFlags(command, arguments->defaults.mesh);
  AddRequestFlags(command, arguments->defaults.request);
  command.SetCallback([arguments, &exit_code] { exit_code = Batch(*arguments); });
}

}  // namespace voxelpipe::cli
