// Runs the items of a batch.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "batch/item_parser.h"
#include "batch/shard.h"
#include "engine/engine.h"

namespace voxelpipe::cli {

struct BatchPlan {
  std::string manifest, output_dir;
  Shard shard;
  std::vector<std::string> servers;        // empty: in this process
  int jobs = 1;                            // items processed at the same time
  int retries = 5;                         // of an item whose server was lost or failed, besides the first attempt
  std::chrono::seconds busy_timeout{600};  // maximum wait of an item for overloaded servers
  std::chrono::milliseconds lost_timeout{30000};      // maximum wait for any server, once none can be reached
  std::optional<std::chrono::milliseconds> deadline;  // of an attempt
  bool fail_fast = false;
  bool allow_outside = false;  // inputs may name files outside their directory
};

enum class ItemStatus {
  kLeft,     // not done: the run was stopped earlier
  kDone,     // by this run
  kSkipped,  // done by an earlier run of the same input and request
  kFailed,
};

struct ItemReport {
  ItemStatus status = ItemStatus::kLeft;
  absl::Status error = absl::OkStatus();
  bool permanent = false;   // the error is the item's own: a retry would repeat it
  double milliseconds = 0;  // reading, waiting for servers and writing included
  int attempts = 0;
  std::string server, worker;      // of the last attempt; may be empty
  std::string hash;                // of the result
  uint64_t bytes = 0;              // of the result
  std::vector<std::string> files;  // relative to the output directory
  WarningList warnings;
};

struct BatchTotals {
  size_t items = 0, done = 0, skipped = 0, failed = 0, left = 0;
  size_t permanent = 0;  // of those that failed
  size_t warned = 0;     // of the finished ones, now or before, with warnings
  uint64_t bytes = 0;    // of the results that this run made
  size_t ended() const { return done + skipped + failed; }
};

struct BatchResult {
  BatchTotals totals;    // of the items that the run came to; `items` and `left` count those alone
  WarningList warnings;  // of all items, each with its item's id before the location
  double seconds = 0;
  absl::Status gone = absl::OkStatus();    // UNAVAILABLE if the run ended because no server could be reached any more
  absl::Status list = absl::OkStatus();    // why the list ended before its end
  absl::Status report = absl::OkStatus();  // of writing the report
};

struct BatchHooks {
  // The items, in order; empty at the end. An error ends the run once the items before it have ended. From several
  // threads, one at a time.
  std::function<absl::StatusOr<std::optional<BatchItem>>()> next_item;
  // Creates an engine for a server, or for the core in this process (empty name). Called from several threads.
  std::function<std::unique_ptr<Engine>(const std::string& server)> make_engine;
  std::function<int()> stop_signal;  // not 0: stop
  // The retry delay that an overloaded server returned; empty if the error is not one of load.
  std::function<std::optional<std::chrono::milliseconds>(const absl::Status&)> retry_delay;
  // True if an error says that a server could not be reached at all. Absent: no error does.
  std::function<bool(const absl::Status&)> could_not_connect;
  // Called when no server can be reached and the run waits for one, with the last error. From several threads, one at a
  // time.
  std::function<void(const absl::Status&)> on_gone;
  // From the calling thread, periodically, and once at the end.
  std::function<void(size_t ended, size_t failed)> on_progress;
  // With each item that has ended, as it ends: never one that is left. From several threads, one at a time.
  std::function<void(const BatchItem&, const ItemReport&)> on_ended;
};

// Each item is read, skipped if its record shows that it is done, otherwise claimed, run and written: its files appear
// under their names when they are complete, its record after them. An item that another run has claimed is put off
// until it is done there or that run is dead, so that runs of the same list, of any shards and on any hosts, share the
// work. An item's error does not affect other items. A lost or failing server is suspended for a while, and its items
// move to the others; a busy server is retried after the delay that it returned. If no server can be reached for
// `lost_timeout`, the run ends and the remaining items stay undone. A signal cancels running items. Memory does not
// grow with the list. Errors: those of RunPresence::Begin.
absl::StatusOr<BatchResult> RunBatch(const BatchPlan& plan, const BatchHooks& hooks);

}  // namespace voxelpipe::cli
