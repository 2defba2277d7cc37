#include "batch/batch_run.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <mutex>
#include <new>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "batch/claim.h"
#include "batch/done_record.h"
#include "batch/inside.h"
#include "batch/run_presence.h"
#include "batch/server_pool.h"
#include "encode/atomic_file.h"
#include "encode/encode.h"
#include "engine/clock.h"
#include "engine/hash.h"
#include "engine/run_to_files.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using Clock = ServerPool::Clock;

constexpr std::chrono::milliseconds kPollInterval{50};        // poll interval for signals
constexpr std::chrono::milliseconds kClaimPollInterval{250};  // of an item that another run has claimed
constexpr size_t kMaxPutOff = 1024;                           // such items in memory

// Permanent errors: the item's own, so that any server repeats them.
bool IsPermanent(const absl::Status& status, bool by_server) {
  if (IsOutputError(status)) return false;  // a full disk is not
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
    case absl::StatusCode::kUnimplemented:
    case absl::StatusCode::kResourceExhausted: return true;  // a limit: a busy server returns a retry delay instead
    case absl::StatusCode::kPermissionDenied: return !by_server;  // of a file, not the client's rights
    default: return false;
  }
}

// Errors that another server, or the same one later, may not repeat.
bool IsWorthAnotherTry(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kAborted:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kCancelled: return true;  // by the server: it shuts down
    default: return false;
  }
}

class Run {
 public:
  Run(const BatchPlan& plan, const BatchHooks& hooks) : plan_(plan), hooks_(hooks), servers_(plan.servers.size()) {}

  absl::StatusOr<BatchResult> Go() {
    const Stopwatch clock;
    absl::StatusOr<RunPresence> presence = RunPresence::Begin(plan_.output_dir);
    if (!presence.ok()) return presence.status();
    presence_ = &*presence;
    const auto count = size_t(std::max(1, plan_.jobs));
    {
      const std::lock_guard lock(mutex_);
      workers_ = count;
      running_.assign(count, nullptr);
    }
    std::vector<std::thread> threads;
    for (size_t i = 0; i < count; ++i) threads.emplace_back([this, i] { Work(i); });
    Watch();
    for (std::thread& thread : threads) thread.join();
    if (hooks_.on_progress) hooks_.on_progress(result_.totals.ended(), result_.totals.failed);
    result_.totals.left = result_.totals.items - result_.totals.ended();
    result_.seconds = clock.Milliseconds() / 1000;
    return std::move(result_);
  }

 private:
  // An item that another run has claimed.
  struct PutOff {
    BatchItem item;
    Clock::time_point until;
  };

  // Polls for a signal until the workers have ended.
  void Watch() {
    Clock::time_point next_beat = Clock::now() + RunPresence::kBeatInterval;
    std::unique_lock lock(mutex_);
    while (!changed_.wait_for(lock, kPollInterval, [this] { return workers_ == 0; })) {
      if (hooks_.stop_signal && hooks_.stop_signal() != 0) {
        stopping_ = true;
        for (JobContext* job : running_) {
          if (job != nullptr) job->Cancel();
        }
        changed_.notify_all();
      }
      const BatchTotals totals = result_.totals;
      lock.unlock();
      if (const Clock::time_point now = Clock::now(); now >= next_beat) {
        presence_->Beat();
        next_beat = now + RunPresence::kBeatInterval;
      }
      if (hooks_.on_progress) hooks_.on_progress(totals.ended(), totals.failed);
      lock.lock();
    }
  }

  void Work(size_t worker) {
    std::vector<std::unique_ptr<Engine>> engines(std::max<size_t>(1, plan_.servers.size()));
    while (std::optional<BatchItem> item = NextItem()) {
      ItemReport report;
      const Stopwatch clock;
      const absl::Status status = DoItem(*item, worker, engines, report);
      report.milliseconds = clock.Milliseconds();
      if (status.ok() && report.status == ItemStatus::kLeft) {
        const std::lock_guard lock(mutex_);
        put_off_.push_back({*std::move(item), Clock::now() + kClaimPollInterval});
      } else {
        Ended(*item, status, report);
      }
    }
    const std::lock_guard lock(mutex_);
    --workers_;
    changed_.notify_all();
  }

  // Those that were put off come after all others, or before where they are too many to keep.
  std::optional<BatchItem> NextItem() {
    if (std::optional<BatchItem> item = NextOfList()) return item;
    std::unique_lock lock(mutex_);
    while (!IsOver() && !put_off_.empty()) {
      if (const Clock::time_point until = put_off_.front().until; Clock::now() < until) {
        changed_.wait_until(lock, until);
        continue;
      }
      BatchItem item = std::move(put_off_.front().item);
      put_off_.pop_front();
      return item;
    }
    return std::nullopt;
  }

  std::optional<BatchItem> NextOfList() {
    const std::lock_guard one_reader(list_mutex_);
    {
      const std::lock_guard lock(mutex_);
      if (list_ended_ || IsOver() || put_off_.size() >= kMaxPutOff) return std::nullopt;
    }
    absl::StatusOr<std::optional<BatchItem>> item = hooks_.next_item();
    const std::lock_guard lock(mutex_);
    if (item.ok() && item->has_value()) {
      ++result_.totals.items;
      return *std::move(item);
    }
    list_ended_ = true;
    if (!item.ok()) result_.list = item.status();
    return std::nullopt;
  }

  // Under the lock: no further item begins.
  bool IsOver() const { return stopping_ || (plan_.fail_fast && result_.totals.failed > 0); }

  void Ended(const BatchItem& item, const absl::Status& status, ItemReport& report) {
    const std::lock_guard lock(mutex_);
    BatchTotals& totals = result_.totals;
    if (status.ok()) {
      ++(report.status == ItemStatus::kDone ? totals.done : totals.skipped);
      if (report.status == ItemStatus::kDone) totals.bytes += report.bytes;
      if (!report.warnings.empty()) ++totals.warned;
      AddWarningsOf(item, report);
    } else {
      if (stopping_) return;  // ended by the stop, whatever its status
      report.status = ItemStatus::kFailed;
      report.error = status;
      report.permanent = report.permanent || IsPermanent(status, !plan_.servers.empty() && report.attempts > 0);
      if (IsBusy(status)) report.permanent = false;
      ++totals.failed;
      totals.permanent += report.permanent ? 1 : 0;
    }
    if (hooks_.on_ended) hooks_.on_ended(item, report);
  }

  void AddWarningsOf(const BatchItem& item, const ItemReport& report) {
    WarningList& all = result_.warnings;
    for (const Warning& warning : report.warnings.kept()) {
      all.Add(warning.code, absl::StrCat(item.id, warning.place.empty() ? "" : ": ", warning.place), warning.text);
    }
    all.set_left_out(all.left_out() + report.warnings.left_out());
  }

  bool IsBusy(const absl::Status& status) const { return hooks_.retry_delay && hooks_.retry_delay(status).has_value(); }

  bool Stopping() {
    const std::lock_guard lock(mutex_);
    return stopping_;
  }

  // False if the run was stopped in the meantime.
  bool WaitUntil(Clock::time_point time) {
    std::unique_lock lock(mutex_);
    return !changed_.wait_until(lock, time, [this] { return stopping_; });
  }

  // The inputs in memory, and the key of their outputs.
  struct Prepared {
    MeshInputs meshes;
    std::string key;
  };

  absl::StatusOr<Prepared> Prepare(const BatchItem& item, const JobContext& job) const {
    const bool several = !item.meshes.paths.empty();
    Prepared prepared;
    std::string hashes;
    for (const std::string& path : several ? item.meshes.paths : std::vector<std::string>{item.input}) {
      absl::StatusOr<MeshInput> mesh =
          ReadMeshInput(path, {{plan_.allow_outside, TexturesRead(item.request->request)}, item.type}, job);
      if (!mesh.ok()) {
        return absl::Status(mesh.status().code(), absl::StrCat(path, ": ", std::string(mesh.status().message())));
      }
      absl::StrAppend(&hashes, Sha256Hex(mesh->bytes));
      prepared.meshes.files.push_back(*std::move(mesh));
    }
    prepared.meshes.placed = item.meshes.placed;
    if (several) absl::StrAppend(&hashes, PlacingText(item.meshes.placed));
    const std::span<const uint8_t> text(reinterpret_cast<const uint8_t*>(hashes.data()), hashes.size());
    absl::StatusOr<std::string> key = ItemKey(item, several ? Sha256Hex(text) : hashes);
    if (!key.ok()) return key.status();
    prepared.key = *std::move(key);
    return prepared;
  }

  // True if everything that the item writes stays in the output directory.
  absl::Status CheckOutputs(const BatchItem& item) const {
    std::vector<std::string> paths = {RecordPath(plan_.output_dir, item)};
    const auto add = [&](const std::string& name) { paths.push_back((fs::path(plan_.output_dir) / name).string()); };
    for (const std::string& name : WrittenPaths(item.output, item.request->request.targets.size())) add(name);
    if (!item.preview.empty()) add(item.preview);
    for (const std::string& path : paths) {
      if (absl::Status s = CheckInside(plan_.output_dir, path); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  // True, and the report is that of the item's record, if it has one.
  bool IsDone(const BatchItem& item, const Prepared& prepared, ItemReport& report) const {
    const absl::StatusOr<DoneRecord> record = FindRecord(plan_.output_dir, item, prepared.key);
    if (!record.ok()) return false;
    report.status = ItemStatus::kSkipped;
    Tell(*record, report);
    return true;
  }

  // OK with a report that says kLeft: another run has the item.
  absl::Status DoItem(const BatchItem& item, size_t worker, std::vector<std::unique_ptr<Engine>>& engines,
                      ItemReport& report) {
    try {
      // Before the inputs are read: an item that another run has is looked at again and again.
      if (Claim::IsTaken(plan_.output_dir, item, *presence_)) return absl::OkStatus();
      const JobContext reading;
      absl::StatusOr<Prepared> prepared = Prepare(item, reading);
      if (!prepared.ok()) return prepared.status();
      if (IsDone(item, *prepared, report)) {
        Claim::RemoveDead(plan_.output_dir, item, *presence_);
        return absl::OkStatus();
      }
      if (absl::Status s = CheckOutputs(item); !s.ok()) return s;  // before anything is written
      const absl::StatusOr<std::optional<Claim>> claim = Claim::Take(plan_.output_dir, item, *presence_);
      if (!claim.ok()) return claim.status();
      if (!claim->has_value()) return absl::OkStatus();
      if (IsDone(item, *prepared, report)) return absl::OkStatus();  // until the claim it was another run's
      if (absl::Status s = RemoveRecord(plan_.output_dir, item); !s.ok()) return s;
      if (plan_.servers.empty()) {
        if (engines[0] == nullptr) engines[0] = hooks_.make_engine("");
        return Attempt(item, *std::move(prepared), worker, *engines[0], report).status;
      }
      return DoOnServers(item, std::move(prepared), worker, engines, report);
    } catch (const std::bad_alloc&) {
      return absl::ResourceExhaustedError("out of memory");
    } catch (const std::exception& error) {
      return absl::InternalError(error.what());
    }
  }

  // Repeats attempts until one is final. Each retry reads the mesh again: it is not kept while it is sent.
  absl::Status DoOnServers(const BatchItem& item, absl::StatusOr<Prepared> prepared, size_t worker,
                           std::vector<std::unique_ptr<Engine>>& engines, ItemReport& report) {
    std::optional<Clock::time_point> busy_since;
    for (int failures = 0;;) {
      const absl::StatusOr<size_t> taken = TakeServer();
      if (!taken.ok()) return taken.status();
      const size_t server = *taken;
      const PlaceBack place(servers_, server);
      report.server = plan_.servers[server];
      if (engines[server] == nullptr) engines[server] = hooks_.make_engine(plan_.servers[server]);
      if (!prepared.ok()) prepared = Prepare(item, JobContext());
      if (!prepared.ok()) return prepared.status();
      const Attempted attempted = Attempt(item, *std::move(prepared), worker, *engines[server], report);
      prepared = absl::UnavailableError("used up");

      const absl::Status& status = attempted.status;
      const Clock::time_point now = Clock::now();
      if (!attempted.by_engine || Stopping()) return status;
      if (const auto delay = hooks_.retry_delay ? hooks_.retry_delay(status) : std::nullopt) {
        servers_.Busy(server, now, *delay);
        if (!busy_since) busy_since = now;
        if (now - *busy_since >= plan_.busy_timeout) return status;
        continue;
      }
      if (!IsWorthAnotherTry(status)) {
        servers_.Answered(server);
        return status;
      }
      if (hooks_.could_not_connect && hooks_.could_not_connect(status)) {
        engines[server] = nullptr;
        Unreachable(server, now, status);  // the item was not tried
        continue;
      }
      // A late answer may be the job's fault as well as the server's: others need not suffer for it.
      if (!absl::IsDeadlineExceeded(status)) {
        servers_.Lost(server, now);
        engines[server] = nullptr;  // forces a new connection
      }
      if (++failures > plan_.retries) return status;
    }
  }

  // Waits while all servers are suspended. CANCELLED if the run was stopped; ends it if no server can be reached for
  // too long.
  absl::StatusOr<size_t> TakeServer() {
    for (;;) {
      if (Stopping()) return absl::CancelledError("stopped");
      const Clock::time_point now = Clock::now();
      const std::optional<Clock::time_point> gone_since = servers_.GoneSince();
      if (gone_since && now - *gone_since >= plan_.lost_timeout) {
        GiveUp(now - *gone_since);
        continue;
      }
      if (const std::optional<size_t> server = servers_.Take(now)) return *server;
      Clock::time_point until = servers_.NextFree();
      if (gone_since) until = std::min(until, *gone_since + plan_.lost_timeout);
      if (!WaitUntil(until)) return absl::CancelledError("stopped");
    }
  }

  void Unreachable(size_t server, Clock::time_point now, const absl::Status& status) {
    servers_.Unreachable(server, now);
    const bool all = servers_.GoneSince().has_value();
    const std::lock_guard lock(mutex_);
    last_unreachable_ = status;
    if (!std::exchange(told_gone_, all) && all && hooks_.on_gone) hooks_.on_gone(status);
  }

  void GiveUp(Clock::duration waited) {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    result_.gone = absl::UnavailableError(absl::StrCat(
        plan_.servers.size() == 1 ? "the server" : absl::StrCat("none of ", plan_.servers.size(), " servers"),
        plan_.servers.size() == 1 ? " could not be reached for " : " could be reached for ",
        std::chrono::duration_cast<std::chrono::seconds>(waited).count(),
        " s: ", std::string(last_unreachable_.message())));
    stopping_ = true;
    changed_.notify_all();
  }

  struct Attempted {
    absl::Status status;
    bool by_engine = false;  // the status is from the engine, a server, or the files written during the run
  };

  Attempted Attempt(const BatchItem& item, Prepared prepared, size_t worker, Engine& engine, ItemReport& report) {
    ++report.attempts;
    JobContext job;
    if (plan_.deadline) job.set_deadline(Clock::now() + *plan_.deadline);
    const CancelledByStop by_stop(*this, worker, job);
    OutputPlan files;
    files.result = (fs::path(plan_.output_dir) / item.output).string();
    if (!item.preview.empty()) files.preview = (fs::path(plan_.output_dir) / item.preview).string();
    files.view = item.view;
    VoxelizeReport made;
    const absl::StatusOr<EngineRun> run =
        RunToFiles(engine, std::move(prepared.meshes), item.request->request, 1, files, job, made);
    if (!run.ok()) return {run.status(), true};
    DoneRecord record;
    record.key = std::move(prepared.key);
    record.hash = made.hash;
    record.bytes = made.bytes;
    for (const std::string& path : made.files) {
      record.files.push_back({fs::path(path).lexically_relative(plan_.output_dir).string(), 0});
    }
    record.warnings = run->warnings;
    if (absl::Status s = WriteRecord(plan_.output_dir, item, record); !s.ok()) return {s, false};
    report.status = ItemStatus::kDone;
    if (run->served) report.worker = run->served->worker;
    Tell(record, report);
    return {absl::OkStatus(), true};
  }

  static void Tell(const DoneRecord& record, ItemReport& report) {
    report.hash = record.hash;
    report.bytes = record.bytes;
    report.warnings = record.warnings;
    for (const DoneRecord::File& file : record.files) report.files.push_back(file.name);
  }

  // RAII: releases the slot at a server on every exit of the attempt.
  class PlaceBack {
   public:
    PlaceBack(ServerPool& servers, size_t server) : servers_(servers), server_(server) {}
    ~PlaceBack() { servers_.Return(server_); }
    PlaceBack(const PlaceBack&) = delete;
    PlaceBack& operator=(const PlaceBack&) = delete;

   private:
    ServerPool& servers_;
    const size_t server_;
  };

  // During its lifetime, a stop of the run cancels the job.
  class CancelledByStop {
   public:
    CancelledByStop(Run& run, size_t worker, JobContext& job) : run_(run), worker_(worker) {
      const std::lock_guard lock(run_.mutex_);
      run_.running_[worker_] = &job;
      if (run_.stopping_) job.Cancel();
    }
    ~CancelledByStop() {
      const std::lock_guard lock(run_.mutex_);
      run_.running_[worker_] = nullptr;
    }
    CancelledByStop(const CancelledByStop&) = delete;
    CancelledByStop& operator=(const CancelledByStop&) = delete;

   private:
    Run& run_;
    const size_t worker_;
  };

  const BatchPlan& plan_;
  const BatchHooks& hooks_;
  ServerPool servers_;
  const RunPresence* presence_ = nullptr;  // of this run
  std::mutex list_mutex_;                  // guards the reading of the list; taken before the other
  std::mutex mutex_;                       // guards the members below
  std::condition_variable changed_;
  std::vector<JobContext*> running_;  // of each worker
  std::deque<PutOff> put_off_;
  size_t workers_ = 0;
  bool list_ended_ = false, stopping_ = false, told_gone_ = false;
  absl::Status last_unreachable_ = absl::OkStatus();
  BatchResult result_;
};

}  // namespace

absl::StatusOr<BatchResult> RunBatch(const BatchPlan& plan, const BatchHooks& hooks) {
  return Run(plan, hooks).Go();
}

}  // namespace voxelpipe::cli
