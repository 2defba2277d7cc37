#include "isolate/load_worker.h"

#include <malloc.h>
#include <pthread.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <exception>
#include <new>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "isolate/channel.h"
#include "isolate/mesh_fields.h"
#include "isolate/sandbox.h"
#include "load/decode/image.h"
#include "load/load_mesh.h"

namespace voxelpipe {
namespace {

static_assert(kCancelSignal == SIGUSR1);

// The current request, for the signal handler: a late signal must not cancel the next request. The handler runs only on
// the main thread, whose stack holds the job; other threads block the signal.
std::atomic<JobContext*> current_job{nullptr};
std::atomic<int> current_number{0};
pthread_t main_thread;

void OnCancel(int, siginfo_t* info, void*) {
  if (pthread_equal(pthread_self(), main_thread) == 0) return;  // the server kills processes that do not end
  JobContext* const job = current_job.load();
  if (job != nullptr && info->si_value.sival_int == current_number.load()) job->Cancel();
}

class CurrentJob {
 public:
  CurrentJob(JobContext& job, uint64_t number) {
    current_number = int(number & 0x7fffffff);
    current_job = &job;
  }
  ~CurrentJob() { current_job = nullptr; }
};

// One-time initialization before the sandbox and the first file: threads, the first load of a small file, and the
// process's budget, which reads system files.
void WarmUp(int threads) {
  DefaultMemory();
  std::atomic<int> started{0};
  const auto patience = std::chrono::steady_clock::now() + std::chrono::milliseconds(20);
  tbb::parallel_for(0, threads, [&](int) {
    ++started;
    while (started < threads && std::chrono::steady_clock::now() < patience) {}
  });
  constexpr std::string_view kTriangle =
      R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":36,"uri":"data:;base64,)"
      R"(AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}],"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[)"
      R"({"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"meshes":[{"primitives":[{"attributes":)"
      R"({"POSITION":0}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0})";
  const JobContext job;
  (void)LoadMeshFor(job, {reinterpret_cast<const uint8_t*>(kTriangle.data()), kTriangle.size()}, {});
  try {
    throw std::runtime_error("the first exception");  // initializes the state of exceptions
  } catch (const std::exception&) {}
}

class Worker {
 public:
  explicit Worker(int threads)
      : threads_(threads), channel_(kWorkerSocket, SharedRegion(kWorkerOut), SharedRegion(kWorkerIn), true) {}

  absl::Status SayReady() { return channel_.Send(MessageKind::kReady, 0, {}); }

  // False at the end.
  bool AnswerOne() {
    absl::StatusOr<Message> message = channel_.Receive(std::chrono::milliseconds(-1));
    if (absl::IsDeadlineExceeded(message.status())) return true;  // a signal came
    if (!message.ok()) return false;
    if (message->kind == MessageKind::kTrim) {
      malloc_trim(0);
      return true;
    }
    absl::Status status = absl::ResourceExhaustedError("not enough memory to load the mesh");
    try {
      status = Answer(*message);
    } catch (const std::bad_alloc&) {
    } catch (const std::exception& error) {
      status = absl::InternalError(absl::StrCat("unexpected: ", error.what()));
    }
    if (status.ok()) return true;
    ArchiveWriter failure;
    Fields(failure, status);
    return channel_.Send(MessageKind::kAnswer, message->number, failure).ok();
  }

 private:
  // Sends the answer, or the reason why there is none.
  absl::Status Answer(const Message& message) {
    ArchiveReader reader(message.text, message.bulk);
    LoadQuestion question;
    QuestionFields(reader, question);
    JobContext job;
    if (question.deadline_ns > 0) {
      job.set_deadline(JobContext::Clock::time_point(std::chrono::nanoseconds(question.deadline_ns)));
    }
    MemoryBudget memory(question.memory_bytes);
    if (question.memory_bytes > 0) job.set_memory(&memory);
    const CurrentJob current(job, message.number);
    tbb::task_arena arena(std::clamp(int(question.threads), 1, threads_));
    return arena.execute([&] {
      return message.kind == MessageKind::kLoad ? Load(message, reader, question, job)
                                                : Textures(message, reader, question, job);
    });
  }

  absl::Status Load(const Message& message, ArchiveReader& reader, const LoadQuestion& question,
                    const JobContext& job) {
    std::span<const uint8_t> file;
    reader.View(file);
    if (absl::Status s = reader.Finish(); !s.ok()) return s;
    const absl::StatusOr<LoadedMesh> loaded =
        LoadMeshFor(job, file, {{question.format, question.unit}, question.textures, question.limits});
    if (!loaded.ok()) return loaded.status();
    ArchiveWriter answer;
    Fields(answer, absl::OkStatus());
    Fields(answer, *loaded);
    return channel_.Send(MessageKind::kAnswer, message.number, answer);
  }

  absl::Status Textures(const Message& message, ArchiveReader& reader, const LoadQuestion& question,
                        const JobContext& job) {
    TriangleMesh mesh;
    TextureFields(reader, mesh);
    if (absl::Status s = reader.Finish(); !s.ok()) return s;
    if (absl::Status s = PrepareTexturesFor(job, mesh, question.limits, question.textures); !s.ok()) return s;
    mesh.parts.clear();
    for (const auto& image : mesh.images) {
      if (image != nullptr) image->encoded = {};  // the server has a copy
    }
    ArchiveWriter answer;
    Fields(answer, absl::OkStatus());
    TextureFields(answer, mesh);
    return channel_.Send(MessageKind::kAnswer, message.number, answer);
  }

  const int threads_;
  Channel channel_;
};

}  // namespace

int RunLoadWorker(int threads, int kept_bytes) {
  BindToParent();
  main_thread = pthread_self();
  sigset_t cancel_signal;
  sigemptyset(&cancel_signal);
  sigaddset(&cancel_signal, kCancelSignal);
  pthread_sigmask(SIG_BLOCK, &cancel_signal, nullptr);
  struct sigaction cancel {};
  cancel.sa_sigaction = OnCancel;
  cancel.sa_flags = SA_SIGINFO | SA_RESTART;
  sigaction(kCancelSignal, &cancel, nullptr);
  mallopt(M_ARENA_MAX, std::clamp(threads, 1, 8));
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // the maximum: larger blocks are returned to the system immediately
  mallopt(M_TRIM_THRESHOLD, std::max(kept_bytes, 1 << 20));
  const tbb::global_control at_most(tbb::global_control::max_allowed_parallelism, size_t(std::max(1, threads)));
  WarmUp(std::max(1, threads));
  pthread_sigmask(SIG_UNBLOCK, &cancel_signal, nullptr);
  Worker worker(std::max(1, threads));
  if (!EnterSandbox().ok()) return 3;
  if (!worker.SayReady().ok()) return 0;
  while (worker.AnswerOne()) {}
  return 0;
}

}  // namespace voxelpipe
