#include <cmath>
#include <exception>
#include <new>
#include <nlohmann/json.hpp>

#include "commands/commands.h"
#include "compare/compare_report.h"
#include "compare/comparison.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "options/request_flags.h"

namespace voxelpipe::cli {
namespace {

struct CompareArguments {
  std::string a, b;
  double tolerance = 0;
  bool json = false;
};

constexpr int kEqual = 0, kDifferent = 1, kCannotCompare = 2;

absl::StatusOr<int> CompareFiles(const CompareArguments& arguments, const JobContext& job) {
  const absl::StatusOr<StoredResult> a = OpenResult(arguments.a);
  if (!a.ok()) return a.status();
  const absl::StatusOr<StoredResult> b = OpenResult(arguments.b);
  if (!b.ok()) return b.status();
  const absl::StatusOr<Comparison> comparison = Compare(job, *a, *b, arguments.tolerance);
  if (!comparison.ok()) return comparison.status();
  const absl::Status told = arguments.json
                                ? PrintLine(JsonText(ComparisonJson(*a, *b, arguments.tolerance, *comparison)))
                                : PrintLines(ComparisonTable(*a, *b, arguments.tolerance, *comparison));
  if (!told.ok()) return told;
  return comparison->equal() ? kEqual : kDifferent;
}

int Run(const CompareArguments& arguments) {
  absl::Status status;
  JobContext job;
  const CancelOnInterrupt cancel(job);
  try {
    if (!std::isfinite(arguments.tolerance) || arguments.tolerance < 0) {
      status = absl::InvalidArgumentError("--tolerance: a number of at least 0");
    } else {
      const absl::StatusOr<int> outcome = CompareFiles(arguments, job);
      if (outcome.ok()) return *outcome;
      status = outcome.status();
    }
  } catch (const std::bad_alloc&) {
    status = absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    status = absl::InternalError(error.what());
  }
  const int signal = InterruptSignal();
  PrintError("", signal != 0 ? absl::CancelledError(StoppedReason(signal)) : status);
  return signal != 0 ? StoppedExitCode(signal) : kCannotCompare;
}

}  // namespace

void AddCompareCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<CompareArguments>();
  Command command = app.AddCommand("compare", "Compare two results: grid, occupancy and values");
  command.SetFooter("Exit status: 0 equal, 1 different, 2 cannot be compared.");
  const char* text = "Results of one kind: .npy, .npz, .raw or .raw.json";
  command.AddOption("A", arguments->a, text).Required().Type("").Check(RefuseEmpty);
  command.AddOption("B", arguments->b, text).Required().Type("").Check(RefuseEmpty);
  command
      .AddOption("--tolerance", arguments->tolerance,
                 Wrapped("Largest difference of two values that is none (default 0)"))
      .Type("T");
  command.AddFlag("--json", arguments->json, "Print one JSON object");
  command.SetCallback([arguments, &exit_code] { exit_code = Run(*arguments); });
}

}  // namespace voxelpipe::cli
