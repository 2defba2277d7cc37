#include "many_stream.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <utility>

#include <grpcpp/support/sync_stream.h>

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32c.h"
#include "call_watch.h"
#include "job/memory_sink.h"
#include "many_call.h"
#include "reply/list_check.h"
#include "result_reader.h"
#include "wire/request.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// An outstanding job.
struct Unanswered {
  Unanswered(VoxelizeRequest asked, const ConnectOptions& options)
      : request(std::move(asked)), reader(request, options.max_result_bytes, sink, options.settings.content_hash) {}

  absl::Status Add(const v1::VoxelizeResponse& part) {
    switch (part.message_case()) {
      case v1::VoxelizeResponse::kHeader: return reader.AddHeader(part.header());
      case v1::VoxelizeResponse::kPiece: return reader.AddPiece(part.piece());
      case v1::VoxelizeResponse::kSummary: return reader.AddSummary(part.summary());
      case v1::VoxelizeResponse::kWhole:
        return absl::DataLossError("the server's result: a whole result as a part of one");
      default: return absl::OkStatus();  // a plan, or a message of a newer server
    }
  }
  absl::StatusOr<RemoteResult> Take() {
    absl::StatusOr<RemoteRun> run = reader.Take();
    if (!run.ok()) return run.status();
    RemoteResult remote{*std::move(run), sink.Take()};
    remote.result.stats = remote.stats;
    if (absl::Status s = CheckLists(remote.result, sink.arrays()); !s.ok()) return s;
    return remote;
  }

  const VoxelizeRequest request;
  MemorySink sink;
  ResultReader reader;
};

}  // namespace

struct ManyStream::Impl {
  Impl(v1::VoxelizationService::Stub& stub, std::string server, const ConnectOptions& connection,
       const JobContext& watched, size_t most)
      : target(std::move(server)), options(connection), job(watched), window(most), watch(context, watched) {
    stream = stub.VoxelizeMany(&context);
  }

  absl::Status Send(uint64_t id, v1::VoxelizeManyRequest message, const VoxelizeRequest& request) {
    if (request.targets.empty()) return absl::InvalidArgumentError("targets: at least one is needed");
    message.set_id(id);
    message.set_takes_more(true);
    message.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(message.mesh().data()), message.mesh().size()}));
    {
      std::unique_lock lock(mutex);
      changed.wait(lock, [this] { return ended || unanswered.size() < window; });
      if (!ended && !unanswered.emplace(id, std::make_unique<Unanswered>(request, options)).second) {
        return absl::InvalidArgumentError(absl::StrCat("id: a job ", id, " is not answered yet"));
      }
    }
    const std::lock_guard lock(write_mutex);
    if (!stream->Write(message)) return absl::UnavailableError(absl::StrCat(target, ": the stream has ended"));
    return absl::OkStatus();
  }

  absl::StatusOr<ManyAnswer> Receive() {
    const std::lock_guard one_reader(read_mutex);
    while (const v1::VoxelizeManyResponse* next = NextMessage()) {
      absl::StatusOr<std::optional<ManyAnswer>> answer = Take(*next);
      if (!answer.ok()) {
        context.TryCancel();
        End();
        return answer.status();
      }
      if (*answer) return **std::move(answer);
    }
    End();
    if (!status) status = CallStatus(stream->Finish(), job, target);
    return status->ok() ? absl::OutOfRangeError("all jobs are answered") : *status;
  }

  // The next response, in a message of its own or with others; null at the end of the stream.
  const v1::VoxelizeManyResponse* NextMessage() {
    if (taken < received.more_size()) return &received.more(taken++);
    taken = 0;
    return stream->Read(&received) ? &received : nullptr;
  }

  // Errors are those of the stream.
  absl::StatusOr<std::optional<ManyAnswer>> Take(const v1::VoxelizeManyResponse& message) {
    Unanswered* one = nullptr;
    {
      const std::lock_guard lock(mutex);
      const auto found = unanswered.find(message.id());
      if (found != unanswered.end()) one = found->second.get();
    }
    if (one == nullptr)
      return absl::DataLossError(absl::StrCat("an answer to job ", message.id(), ", which waits for none"));
    ManyAnswer answer;
    answer.id = message.id();
    if (message.has_error()) {
      if (message.error().code() == int(grpc::StatusCode::OK)) {
        return absl::DataLossError("the server's answer: an error of the code OK");
      }
      answer.result = FromGrpcStatus(grpc::Status(grpc::StatusCode(message.error().code()), message.error().message(),
                                                  message.error().SerializeAsString()));
    } else if (message.has_whole()) {
      absl::Status s = one->reader.AddWhole(message.whole());
      answer.result = s.ok() ? one->Take() : absl::StatusOr<RemoteResult>(std::move(s));
    } else {
      absl::Status s = one->Add(message.part());
      if (!s.ok()) return s;  // more of it may come, and could not be told apart
      if (!message.part().has_summary()) return std::optional<ManyAnswer>();
      answer.result = one->Take();
    }
    {
      const std::lock_guard lock(mutex);
      unanswered.erase(message.id());
    }
    changed.notify_all();
    return std::optional<ManyAnswer>(std::move(answer));
  }

  // No further answers.
  void End() {
    {
      const std::lock_guard lock(mutex);
      ended = true;
    }
    changed.notify_all();
  }

  const std::string target;
  const ConnectOptions options;
  const JobContext& job;
  const size_t window;
  grpc::ClientContext context;
  const CallWatch watch;
  std::unique_ptr<grpc::ClientReaderWriter<v1::VoxelizeManyRequest, v1::VoxelizeManyResponse>> stream;
  std::mutex write_mutex, read_mutex;  // gRPC allows one of each at a time
  // Guarded by read_mutex:
  std::optional<absl::Status> status;
  v1::VoxelizeManyResponse received;  // the last message
  int taken = 0;                      // of its further responses

  std::mutex mutex;
  std::condition_variable changed;
  std::unordered_map<uint64_t, std::unique_ptr<Unanswered>> unanswered;
  bool ended = false;
};

ManyStream::ManyStream(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

ManyStream::~ManyStream() {
  if (impl_->status) return;
  impl_->context.TryCancel();
  v1::VoxelizeManyResponse message;
  while (impl_->stream->Read(&message)) {}
  impl_->stream->Finish();
}

absl::Status ManyStream::Send(uint64_t id, std::span<const uint8_t> mesh_bytes, MeshFileType type,
                              const VoxelizeRequest& request) {
  v1::VoxelizeManyRequest message;
  *message.mutable_config() = MakeConfig(request, type, impl_->options.settings);
  message.set_mesh(mesh_bytes.data(), mesh_bytes.size());
  return impl_->Send(id, std::move(message), request);
}

absl::Status ManyStream::SendStored(uint64_t id, const std::string& mesh_id, const VoxelizeRequest& request,
                                    std::span<const float> new_positions) {
  v1::VoxelizeManyRequest message;
  *message.mutable_config() = MakeConfig(request, MeshFormat::kAuto, impl_->options.settings);
  message.mutable_config()->set_mesh_id(mesh_id);
  message.mutable_config()->set_new_positions(!new_positions.empty());
  message.set_mesh(new_positions.data(), new_positions.size_bytes());
  return impl_->Send(id, std::move(message), request);
}

void ManyStream::FinishSending() {
  const std::lock_guard lock(impl_->write_mutex);
  impl_->stream->WritesDone();
}

absl::StatusOr<ManyAnswer> ManyStream::Receive() {
  return impl_->Receive();
}

size_t ManyStream::window() const {
  return impl_->window;
}

std::unique_ptr<ManyStream> OpenManyStream(v1::VoxelizationService::Stub& stub, const std::string& target,
                                           const ConnectOptions& options, const JobContext& job, size_t window) {
  return std::make_unique<ManyStream>(
      std::make_unique<ManyStream::Impl>(stub, target, options, job, std::max<size_t>(1, window)));
}

}  // namespace voxelpipe
