#include "io_threads.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>

#include <grpc/support/cpu.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

namespace voxelpipe {
namespace {

// gRPC's names of these threads.
constexpr char kName[] = "nexting_thread";
// Of all servers of this process.
std::mutex g_mutex;
size_t g_held = 0;

// For a call that the server refuses at once.
constexpr std::chrono::seconds kPatience{5};

// A new thread has no name yet, and a thread of an earlier server keeps its name until it has ended: threads beyond
// those that gRPC starts do not wait for calls.
size_t CountStarted() {
  constexpr int kLooks = 200;
  constexpr std::chrono::milliseconds kBetween{5};
  const size_t expected = std::clamp<size_t>(gpr_cpu_num_cores() / 2, 2, 16);
  size_t count = IoThreads::Count();
  for (int i = 0; i < kLooks && count < expected; ++i) {
    std::this_thread::sleep_for(kBetween);
    count = IoThreads::Count();
  }
  return std::min(count, expected);
}

}  // namespace

// Shared with the callbacks, one of which may come late.
struct IoThreads::Hold {
  std::mutex mutex;
  std::condition_variable changed;
  size_t came = 0, held = 0;
  bool over = false;

  // On a gRPC thread.
  void Wait() {
    std::unique_lock lock(mutex);
    ++came;
    ++held;
    changed.notify_all();
    changed.wait(lock, [this] { return over; });
    --held;
    changed.notify_all();
  }
};

struct IoThreads::Call {
  grpc::ClientContext context;
  const grpc::Slice nothing;
  const grpc::ByteBuffer request{&nothing, 1};
  grpc::ByteBuffer response;
};

IoThreads::IoThreads(size_t keep, const std::shared_ptr<grpc::Channel>& channel) : hold_(std::make_shared<Hold>()) {
  const std::lock_guard one_at_a_time(g_mutex);
  const size_t started = CountStarted(), count = started - std::min(started, g_held);
  const size_t least = std::max<size_t>(1, keep);
  if (count <= least) return;
  grpc::GenericStub stub(channel);
  for (size_t i = least; i < count; ++i) {
    Call& call = *calls_.emplace_back(std::make_unique<Call>());
    call.context.set_deadline(std::chrono::system_clock::now() + kPatience);
    // The end of a call is reported on one of these threads; that of a call without a handler comes at once.
    stub.UnaryCall(&call.context, "/voxelpipe.internal/Hold", {}, &call.request, &call.response,
                   [hold = hold_](const grpc::Status&) { hold->Wait(); });
  }
  std::unique_lock lock(hold_->mutex);
  hold_->changed.wait(lock, [&] { return hold_->came == count - least; });
  g_held += count - least;
}

IoThreads::~IoThreads() {
  const std::lock_guard one_at_a_time(g_mutex);
  g_held -= calls_.size();
  std::unique_lock lock(hold_->mutex);
  hold_->over = true;
  hold_->changed.notify_all();
  hold_->changed.wait(lock, [this] { return hold_->held == 0; });
  // Calls, and possibly the channel with the last call, are destroyed here and not on gRPC's threads: the last channel
  // waits for the end of these threads.
}

size_t IoThreads::held() const {
  const std::lock_guard lock(hold_->mutex);
  return hold_->held;
}

size_t IoThreads::Count() {
  size_t count = 0;
  std::error_code error;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task", error)) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm"), name);
    if (name == kName) ++count;
  }
  return count;
}

}  // namespace voxelpipe
