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
#include "batch/manifest.h"
#include "engine/engine.h"

namespace voxelpipe::cli {

struct BatchPlan {
  std::string manifest, output_dir;
  Shard shard;
  std::vector<BatchItem> items;            // of the shard
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

struct BatchResult {
  std::vector<ItemReport> items;  // in order
  double seconds = 0;
  absl::Status gone = absl::OkStatus();  // UNAVAILABLE if the run ended because no server could be reached any more
};

struct BatchHooks {
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
  std::function<void(const BatchItem&, const absl::Status&)> on_failure;  // from several threads, one at a time
};

// Each item is read, skipped if its record shows that it is done, otherwise run and written: its files appear under
// their names when they are complete, its record after them. An item's error does not affect other items. A lost or
// failing server is suspended for a while, and its items move to the others; a busy server is retried after the delay
// that it returned. If no server can be reached for `lost_timeout`, the run ends and the remaining items stay undone. A
// signal cancels running items.
BatchResult RunBatch(const BatchPlan& plan, const BatchHooks& hooks);

}  // namespace voxelpipe::cli
