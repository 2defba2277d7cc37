#include "many_stream.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <utility>

#include <grpcpp/support/sync_stream.h>

#include "absl/strings/str_cat.h"
#include "call_watch.h"
#include "job/memory_sink.h"
#include "many_call.h"
#include "reply/list_check.h"
#include "result_reader.h"
#include "voxelize_call.h"
#include "wire/request.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// An outstanding job.
struct Unanswered {
  Unanswered(VoxelizeRequest asked, const ConnectOptions& options)
      : request(std::move(asked)), reader(request, options.max_result_bytes, sink, options.settings.content_hash) {}

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
    stream = stub.VoxelizeBatch(&context);
  }

  absl::Status Send(uint64_t id, const MeshSource& mesh, const VoxelizeRequest& request) {
    if (absl::Status s = CheckSendable(request); !s.ok()) return s;
    v1::VoxelizeBatchRequest message;
    v1::BatchJob& one = *message.add_jobs();
    one.set_id(id);
    *one.mutable_request() = MakeRequest(request, options.settings);
    WriteWithBytes(mesh, *one.mutable_request()->mutable_mesh());
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
    while (const v1::BatchReply* next = NextReply()) {
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

  // Null at the end of the stream.
  const v1::BatchReply* NextReply() {
    while (taken == received.replies_size()) {
      taken = 0;
      if (!stream->Read(&received)) {
        received.Clear();
        return nullptr;
      }
    }
    return &received.replies(taken++);
  }

  // Errors are those of the stream.
  absl::StatusOr<std::optional<ManyAnswer>> Take(const v1::BatchReply& reply) {
    Unanswered* one = nullptr;
    {
      const std::lock_guard lock(mutex);
      const auto found = unanswered.find(reply.id());
      if (found != unanswered.end()) one = found->second.get();
    }
    if (one == nullptr) {
      return absl::DataLossError(absl::StrCat("an answer to job ", reply.id(), ", which waits for none"));
    }
    ManyAnswer answer;
    answer.id = reply.id();
    if (reply.has_error()) {
      if (reply.error().code() == int(grpc::StatusCode::OK)) {
        return absl::DataLossError("the server's answer: an error of the code OK");
      }
      answer.result = FromGrpcStatus(grpc::Status(grpc::StatusCode(reply.error().code()), reply.error().message(),
                                                  reply.error().SerializeAsString()));
    } else {
      const bool last = reply.response().has_summary();
      absl::Status s = one->reader.Add(reply.response());
      if (!s.ok() && !last) return s;  // more of it may come, and could not be told apart
      if (!last) return std::optional<ManyAnswer>();
      answer.result = s.ok() ? one->Take() : absl::StatusOr<RemoteResult>(std::move(s));
    }
    {
      const std::lock_guard lock(mutex);
      unanswered.erase(reply.id());
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
  std::unique_ptr<grpc::ClientReaderWriter<v1::VoxelizeBatchRequest, v1::VoxelizeBatchResponse>> stream;
  std::mutex write_mutex, read_mutex;  // gRPC allows one of each at a time
  // Guarded by read_mutex:
  std::optional<absl::Status> status;
  v1::VoxelizeBatchResponse received;  // the last message
  int taken = 0;                       // of its replies

  std::mutex mutex;
  std::condition_variable changed;
  std::unordered_map<uint64_t, std::unique_ptr<Unanswered>> unanswered;
  bool ended = false;
};

ManyStream::ManyStream(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

ManyStream::~ManyStream() {
  if (impl_->status) return;
  impl_->context.TryCancel();
  v1::VoxelizeBatchResponse message;
  while (impl_->stream->Read(&message)) {}
  impl_->stream->Finish();
}

absl::Status ManyStream::Send(uint64_t id, std::span<const uint8_t> mesh_bytes, MeshFileType type,
                              const VoxelizeRequest& request) {
  return impl_->Send(id, MeshSource::File(mesh_bytes, type), request);
}

absl::Status ManyStream::SendStored(uint64_t id, const std::string& mesh_name, const VoxelizeRequest& request,
                                    std::span<const float> new_positions) {
  return impl_->Send(id, MeshSource::Stored(mesh_name, new_positions), request);
}

absl::Status ManyStream::SendPlaced(uint64_t id, std::span<const PlacedStored> meshes, const VoxelizeRequest& request) {
  return impl_->Send(id, MeshSource::Placed(meshes), request);
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
