// A small mesh goes in one message (Voxelize). A thread of its own uploads a larger one (VoxelizeUpload) while the
// calling thread reads, so that an early refusal is seen at once and full buffers on both sides cannot deadlock.
#include "voxelize_call.h"

#include <algorithm>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include <grpcpp/impl/codegen/proto_utils.h>

#include "base/checksum/crc32c.h"
#include "call_watch.h"
#include "grid/grid_spec.h"
#include "job/memory_sink.h"
#include "reply/list_check.h"
#include "result_reader.h"
#include "upload_pieces.h"
#include "wire/placed.h"
#include "wire/request.h"

namespace voxelpipe {
namespace {

// Meshes up to this size are sent in one message.
constexpr uint64_t kOneMessageBytes = uint64_t{1} << 20;

using UploadStream = RawCalls::UploadStream;

// Both threads report; JobContext requires one at a time. A stage is reported at most about twenty times.
class Reporter {
 public:
  explicit Reporter(const JobContext& job) : job_(job) {}

  void Report(const std::string& stage, double fraction) {
    const std::lock_guard lock(mutex_);
    if (stage == stage_ && fraction < 1 && fraction < fraction_ + 0.05) return;
    stage_ = stage;
    fraction_ = fraction;
    job_.Report(stage_, std::clamp(fraction, 0.0, 1.0));
  }

 private:
  const JobContext& job_;
  std::mutex mutex_;
  std::string stage_;
  double fraction_ = 0;
};

// Ends early, without an error, if the call has ended: the status of the call has the reason.
void Upload(UploadStream& stream, v1::VoxelizeRequest request, std::span<const uint8_t> bytes, Reporter& reporter) {
  v1::VoxelizeUploadRequest message;
  *message.mutable_request() = std::move(request);
  if (!stream.Write(Serialized(message))) return;
  UploadPieces pieces(v1::VoxelizeUploadRequest::kPieceFieldNumber, v1::VoxelizeUploadRequest::kCrc32CFieldNumber);
  for (size_t offset = 0; offset < bytes.size(); offset += kUploadPieceBytes) {
    reporter.Report("upload", double(offset) / double(bytes.size()));
    const size_t piece = std::min(kUploadPieceBytes, bytes.size() - offset);
    if (!stream.Write(pieces.Make(bytes.subspan(offset, piece)))) return;
  }
  stream.WritesDone();
}

// The thread of an upload. RAII: on every exit of the reader, including exceptions of the caller's callbacks, the call
// ends and the thread is joined before its data is destroyed.
class UploadThread {
 public:
  template <typename Body>
  UploadThread(grpc::ClientContext& context, Body body) : context_(context), thread_(std::move(body)) {}
  ~UploadThread() {
    if (!thread_.joinable()) return;
    context_.TryCancel();
    thread_.join();
  }
  UploadThread(const UploadThread&) = delete;
  UploadThread& operator=(const UploadThread&) = delete;

  void Join() { thread_.join(); }

 private:
  grpc::ClientContext& context_;
  std::thread thread_;
};

// Reads the messages of one call to its end; after an error, which is the server's or the sink's, it cancels the call.
template <typename Stream>
absl::Status ReadMessages(grpc::ClientContext& context, Stream& stream, ResultReader& reader) {
  absl::Status broken;
  grpc::ByteBuffer buffer;
  while (stream.Read(&buffer)) {
    if (broken.ok()) broken = reader.Add(buffer);
    buffer.Clear();  // frees its memory for the next one
    if (!broken.ok()) context.TryCancel();
  }
  return broken;
}

}  // namespace

absl::Status CheckSendable(const VoxelizeRequest& request) {
  if (request.targets.empty()) return absl::InvalidArgumentError("targets: at least one is needed");
  return CheckGridRequest(request.grid);
}

void WriteWithBytes(const MeshSource& mesh, v1::MeshSource& message) {
  WriteWithoutBytes(mesh, message);
  const auto write = [&mesh](auto& with_bytes) {
    with_bytes.set_data(mesh.bytes.data(), mesh.bytes.size());
    with_bytes.set_crc32c(Crc32c(mesh.bytes));
  };
  if (message.has_bytes()) write(*message.mutable_bytes());
  if (message.stored().has_positions()) write(*message.mutable_stored()->mutable_positions());
}

void WriteWithoutBytes(const MeshSource& mesh, v1::MeshSource& message) {
  if (mesh.placed) {
    WriteTo(*mesh.placed, *message.mutable_placed());
    return;
  }
  if (!mesh.stored) {
    WriteTo(mesh.type, *message.mutable_bytes());
    return;
  }
  message.mutable_stored()->set_name(*mesh.stored);
  if (!mesh.bytes.empty()) message.mutable_stored()->mutable_positions();
}

absl::StatusOr<RemoteRun> CallVoxelizeTo(const RawCalls& calls, const std::string& target, uint64_t max_result_bytes,
                                         const CallSettings& settings, const MeshSource& mesh,
                                         const VoxelizeRequest& request, const JobContext& job, ResultSink& sink,
                                         const std::function<void(const Plan&)>& on_plan) {
  if (absl::Status status = CheckSendable(request); !status.ok()) return status;
  if (absl::Status status = job.Check(); !status.ok()) return status;
  grpc::ClientContext context;
  const CallWatch watch(context, job);
  Reporter reporter(job);
  ResultReader reader(request, max_result_bytes, sink, settings.content_hash,
                      {on_plan, [&](const std::string& stage, double fraction) { reporter.Report(stage, fraction); }});
  absl::Status broken;
  grpc::Status status;
  v1::VoxelizeRequest message = MakeRequest(request, settings);
  if (mesh.bytes.size() <= kOneMessageBytes) {
    reporter.Report("upload", 0);
    WriteWithBytes(mesh, *message.mutable_mesh());
    const auto stream = calls.Voxelize(context, Serialized(message));
    broken = ReadMessages(context, *stream, reader);
    status = stream->Finish();
  } else {
    WriteWithoutBytes(mesh, *message.mutable_mesh());
    const auto stream = calls.VoxelizeUpload(context);
    UploadThread upload(context, [&] { Upload(*stream, std::move(message), mesh.bytes, reporter); });
    broken = ReadMessages(context, *stream, reader);
    upload.Join();
    status = stream->Finish();
  }
  if (!broken.ok()) return broken;
  if (!status.ok()) return CallStatus(status, job, target);
  return reader.Take();
}

absl::StatusOr<RemoteResult> CallVoxelize(const RawCalls& calls, const std::string& target, uint64_t max_result_bytes,
                                          const CallSettings& settings, const MeshSource& mesh,
                                          const VoxelizeRequest& request, const JobContext& job,
                                          const std::function<void(const Plan&)>& on_plan) {
  MemorySink sink;
  absl::StatusOr<RemoteRun> run =
      CallVoxelizeTo(calls, target, max_result_bytes, settings, mesh, request, job, sink, on_plan);
  if (!run.ok()) return run.status();
  RemoteResult remote{*std::move(run), sink.Take()};
  remote.result.stats = remote.stats;
  if (absl::Status s = CheckLists(remote.result, sink.arrays()); !s.ok()) return s;
  return remote;
}

}  // namespace voxelpipe
