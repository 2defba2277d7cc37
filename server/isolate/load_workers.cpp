#include "isolate/load_workers.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "isolate/load_worker.h"
#include "isolate/mesh_fields.h"
#include "mesh/health/check_mesh.h"
#include "observe/log.h"

namespace voxelpipe {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// How often a call that waits for a process polls its job.
constexpr milliseconds kLookInterval{10};
constexpr milliseconds kRetryInterval{200};  // after a failed start

LoadQuestion QuestionOf(const LoadRequest& request, const JobContext& job, uint64_t memory_bytes, uint32_t threads) {
  LoadQuestion question;
  question.format = request.type.format;
  question.unit = request.type.unit;
  question.textures = request.textures;
  question.limits = request.limits;
  question.memory_bytes = memory_bytes;
  question.threads = threads;
  if (job.deadline()) {
    const auto since_epoch = std::chrono::duration_cast<std::chrono::nanoseconds>(job.deadline()->time_since_epoch());
    question.deadline_ns = std::max<int64_t>(1, since_epoch.count());
  }
  return question;
}

// A time that a process reports, limited to what is possible.
double Plausible(double ms, double most_ms) {
  return std::isfinite(ms) ? std::clamp(ms, 0.0, most_ms) : 0.0;
}

// For each image the index of the first identical one.
std::vector<size_t> FirstOfSame(const std::vector<std::shared_ptr<Image>>& images) {
  std::map<const Image*, size_t> first;
  std::vector<size_t> same;
  for (size_t i = 0; i < images.size(); ++i) same.push_back(first.try_emplace(images[i].get(), i).first->second);
  return same;
}

// The outcome of a check of what a process that may be taken over has sent.
absl::Status Trusted(const absl::Status& checked) {
  if (checked.ok()) return checked;
  return absl::InternalError(
      absl::StrCat("a process that loads meshes returned an invalid mesh: ", std::string(checked.message())));
}

absl::Status TakeTextures(TriangleMesh from, TriangleMesh& mesh) {
  const absl::Status broken = absl::InternalError("the process that decoded textures gave back others");
  const std::vector<size_t> first = FirstOfSame(mesh.images);
  if (from.textures.size() != mesh.textures.size() || FirstOfSame(from.images) != first) return broken;
  for (size_t i = 0; i < mesh.images.size(); ++i) {
    if ((from.images[i] == nullptr) != (mesh.images[i] == nullptr)) return broken;
  }
  for (size_t i = 0; i < mesh.images.size(); ++i) {
    if (mesh.images[i] == nullptr || first[i] != i) continue;
    Image& image = *from.images[i];
    image.name = std::move(mesh.images[i]->name);
    image.mime_type = std::move(mesh.images[i]->mime_type);
    image.encoded = std::move(mesh.images[i]->encoded);
    image.memory = std::move(mesh.images[i]->memory);  // of the encoded bytes
    *mesh.images[i] = std::move(image);
  }
  for (size_t i = 0; i < mesh.textures.size(); ++i) mesh.textures[i].image = from.textures[i].image;
  return absl::OkStatus();
}

// The charge of the images to the job, released with the last of them.
void KeepCharge(MemoryCharge charge, const TriangleMesh& mesh) {
  const auto shared = std::make_shared<MemoryCharge>(std::move(charge));
  for (const std::shared_ptr<Image>& image : mesh.images) {
    if (image == nullptr) continue;
    if (image->memory != nullptr && image->memory != shared) shared->Absorb(std::move(*image->memory));
    image->memory = shared;
  }
}

}  // namespace

// A process for one request.
class LoadWorkers::Lease {
 public:
  Lease(LoadWorkers& workers, std::unique_ptr<WorkerProcess> process)
      : workers_(workers), process_(std::move(process)) {}
  ~Lease() { workers_.GiveBack(std::move(process_)); }
  Lease(const Lease&) = delete;

  WorkerProcess* operator->() const { return process_.get(); }

 private:
  LoadWorkers& workers_;
  std::unique_ptr<WorkerProcess> process_;
};

absl::StatusOr<std::unique_ptr<LoadWorkers>> LoadWorkers::Start(const LoadWorkersOptions& options) {
  std::unique_ptr<LoadWorkers> workers(new LoadWorkers(options));
  workers->thread_ = std::thread([it = workers.get()] { it->Maintain(); });
  const JobContext job;
  auto first = workers->Take(job);
  if (!first.ok()) return first.status();
  const Lease lease(*workers, *std::move(first));
  if (absl::Status s = lease->WaitUntilReady(job); !s.ok()) return s;
  return workers;
}

LoadWorkers::~LoadWorkers() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_.notify_all();
  thread_.join();
}

uint64_t LoadWorkers::MemoryFor(const JobContext& job) const {
  uint64_t bytes = options_.memory_bytes;
  if (const MemoryBudget* const memory = job.memory(); memory != nullptr) {
    const uint64_t left = memory->limit_bytes() - std::min(memory->limit_bytes(), memory->used_bytes());
    bytes = bytes == 0 ? left : std::min(bytes, left);
    bytes = std::max<uint64_t>(bytes, 1);  // 0 would mean no bound
  }
  return bytes;
}

uint32_t LoadWorkers::CountQuestion() {
  const std::lock_guard lock(mutex_);
  ++stats_.questions;
  return uint32_t(std::max<size_t>(1, size_t(std::max(1, options_.threads)) / std::max<size_t>(1, busy_)));
}

absl::Status LoadWorkers::Ask(MessageKind kind, const LoadRequest& request, const JobContext& job,
                              const std::function<void(ArchiveWriter&)>& write,
                              const std::function<absl::Status(ArchiveReader&)>& read, MemoryCharge& kept) {
  constexpr int kAttempts = 3;  // several processes may have been killed at once
  for (int attempt = 1;; ++attempt) {
    auto process = Take(job);
    if (!process.ok()) return process.status();
    const Lease lease(*this, *std::move(process));
    const uint64_t memory_bytes = MemoryFor(job);
    ArchiveWriter question;
    const LoadQuestion asked = QuestionOf(request, job, memory_bytes, CountQuestion());
    QuestionFields(question, asked);
    write(question);
    absl::Status status = lease->Ask(kind, memory_bytes, question, job, read, kept);
    if (status.ok() || !lease->ended_unasked() || attempt == kAttempts) return status;
  }
}

absl::StatusOr<LoadedMesh> LoadWorkers::Load(std::vector<uint8_t> file, const LoadRequest& request,
                                             const JobContext& job) {
  if (absl::Status s = job.Check(); !s.ok()) return s;
  job.Report("load", 0);
  Clock::time_point begin;
  const auto write = [&](ArchiveWriter& question) {
    begin = Clock::now();
    question.Bytes(file);
  };
  LoadedMesh loaded;
  const auto read = [&](ArchiveReader& answer) {
    file = {};
    Fields(answer, loaded);
    absl::Status status = answer.Finish();
    return status.ok() ? Trusted(CheckMesh(loaded.mesh)) : status;
  };
  MemoryCharge kept;
  if (absl::Status s = Ask(MessageKind::kLoad, request, job, write, read, kept); !s.ok()) return s;
  loaded.mesh.memory = std::make_shared<MemoryCharge>(std::move(kept));
  const double ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
  // The transfer of the mesh counts as loading.
  loaded.flatten_ms = Plausible(loaded.flatten_ms, ms);
  loaded.load_ms = ms - loaded.flatten_ms;
  job.Report("load", 1);
  job.Report("flatten", 0);
  job.Report("flatten", 1);
  return loaded;
}

absl::Status LoadWorkers::DecodeTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use,
                                         const JobContext& job) {
  const auto write = [&mesh](ArchiveWriter& question) { TextureFields(question, mesh); };
  const auto read = [&mesh](ArchiveReader& answer) {
    TriangleMesh decoded;
    TextureFields(answer, decoded);
    absl::Status status = answer.Finish();
    if (status.ok()) status = Trusted(CheckTextures(decoded));
    return status.ok() ? TakeTextures(std::move(decoded), mesh) : status;
  };
  MemoryCharge kept;
  const LoadRequest request{MeshFormat::kAuto, use, limits};
  if (absl::Status s = Ask(MessageKind::kTextures, request, job, write, read, kept); !s.ok()) return s;
  KeepCharge(std::move(kept), mesh);
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<WorkerProcess>> LoadWorkers::Take(const JobContext& job) {
  std::unique_lock lock(mutex_);
  const uint64_t failed_before = starts_failed_;
  ++waiting_;
  absl::Status over;
  DropEnded();
  while (idle_.empty() && over.ok()) {
    work_.notify_one();
    freed_.wait_for(lock, kLookInterval);
    over = job.Check();
    if (over.ok() && idle_.empty() && starts_failed_ > failed_before && busy_ == 0) over = start_failure_;
  }
  --waiting_;
  if (!over.ok()) return over;
  std::unique_ptr<WorkerProcess> process = std::move(idle_.back().process);
  idle_.pop_back();
  ++busy_;
  if (Wanted() > 0) work_.notify_one();
  return process;
}

void LoadWorkers::SetWorkers(int workers, uint64_t kept_bytes) {
  {
    const std::lock_guard lock(mutex_);
    kept_bytes_ = kept_bytes;
    most_ = MostOf(workers);
  }
  work_.notify_one();
}

void LoadWorkers::GiveBack(std::unique_ptr<WorkerProcess> process) {
  {
    const std::lock_guard lock(mutex_);
    --busy_;
    if (process->usable()) {
      idle_.push_back({std::move(process), Clock::now(), false});
    } else {
      ++stats_.ended[process->end_reason()];
      ended_.push_back(std::move(process));
      work_.notify_one();
    }
  }
  freed_.notify_one();
}

size_t LoadWorkers::Wanted() const {
  const size_t alive = busy_ + idle_.size();
  const size_t wanted = waiting_ + 1;  // one more than the waiting calls
  if (idle_.size() >= wanted || alive >= most_) return 0;
  return std::min(wanted - idle_.size(), most_ - alive);
}

uint64_t LoadWorkers::KeptShare() const {
  constexpr uint64_t kMinKept = 2 << 20, kMaxKept = 64 << 20;
  return std::clamp(kept_bytes_ / most_, kMinKept, kMaxKept);
}

void LoadWorkers::DropEnded() {
  for (Idle& idle : idle_) {
    if (!idle.process->HasEnded()) continue;
    ++stats_.ended[idle.process->end_reason()];
    ended_.push_back(std::move(idle.process));
  }
  std::erase_if(idle_, [](const Idle& idle) { return idle.process == nullptr; });
}

void LoadWorkers::LookForIdle(Clock::time_point now) {
  DropEnded();
  for (Idle& idle : idle_) {
    if (idle.process->kept_bytes() > KeptShare()) ended_.push_back(std::move(idle.process));
  }
  std::erase_if(idle_, [](const Idle& idle) { return idle.process == nullptr; });
  while (!idle_.empty() && busy_ + idle_.size() > most_) {
    ended_.push_back(std::move(idle_.front().process));
    idle_.erase(idle_.begin());
  }
  if (options_.unused.count() <= 0) return;
  // The least recently used ones are at the front.
  while (idle_.size() > 1 && now - idle_.front().since >= options_.unused) {
    ended_.push_back(std::move(idle_.front().process));
    idle_.erase(idle_.begin());
  }
  for (Idle& idle : idle_) {
    if (idle.trimmed || now - idle.since < options_.unused) continue;
    idle.trimmed = true;
    idle.process->Trim();
  }
}

void LoadWorkers::Maintain() {
  std::unique_lock lock(mutex_);
  Clock::time_point next_start{};
  const milliseconds look =
      options_.unused.count() > 0 ? std::min(options_.unused, milliseconds(1000)) : milliseconds(1000);
  while (!stopping_) {
    LookForIdle(Clock::now());
    if (!ended_.empty()) {
      std::vector<std::unique_ptr<WorkerProcess>> ended;
      ended.swap(ended_);
      lock.unlock();
      for (const auto& process : ended) {
        if (!process->usable()) {
          LogMessage(LogLevel::kInfo, absl::StrCat("a process that loads meshes was ended: ", process->end_reason()));
        }
      }
      ended.clear();
      lock.lock();
      continue;
    }
    if (Wanted() > 0 && Clock::now() >= next_start) {
      WorkerProcess::Options options = options_.process;
      options.kept_bytes = KeptShare();
      lock.unlock();
      auto process = WorkerProcess::Start(options);
      lock.lock();
      if (process.ok()) {
        idle_.insert(idle_.begin(), Idle{*std::move(process), Clock::now(), false});  // those that are ready come first
      } else {
        LogMessage(LogLevel::kError, std::string(process.status().message()));
        start_failure_ = process.status();
        ++starts_failed_;
        next_start = Clock::now() + kRetryInterval;
      }
      freed_.notify_all();
      continue;
    }
    work_.wait_for(lock, Wanted() > 0 ? kRetryInterval : look);
  }
  std::vector<Idle> idle;
  idle.swap(idle_);
  lock.unlock();
  idle.clear();
  ended_.clear();
}

LoadWorkers::Stats LoadWorkers::stats() const {
  const std::lock_guard lock(mutex_);
  Stats stats = stats_;
  stats.busy = int(busy_);
  stats.processes = int(busy_ + idle_.size());
  for (const Idle& idle : idle_) stats.kept_bytes += idle.process->kept_bytes();
  return stats;
}

}  // namespace voxelpipe
