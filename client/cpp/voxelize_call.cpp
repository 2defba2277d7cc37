// A small mesh goes in one message (VoxelizeMesh). A thread of its own uploads a larger one while the calling thread
// reads, so that an early refusal is seen at once and full buffers on both sides cannot deadlock.
#include "voxelize_call.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include <google/protobuf/arena.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include "base/checksum/crc32c.h"
#include "call_watch.h"
#include "job/memory_sink.h"
#include "reply/list_check.h"
#include "reply/piece_view.h"
#include "result_reader.h"
#include "upload_pieces.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// Meshes up to this size are sent in one message.
constexpr uint64_t kOneMessageBytes = uint64_t{1} << 20;

using Stream = RawCalls::VoxelizeStream;

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
void Upload(Stream& stream, const v1::VoxelizeConfig& config, std::span<const uint8_t> mesh_bytes, Reporter& reporter) {
  v1::VoxelizeRequest message;
  *message.mutable_config() = config;
  if (!stream.Write(Serialized(message))) return;
  UploadPieces pieces(v1::VoxelizeRequest::kMeshPieceFieldNumber, v1::VoxelizeRequest::kCrc32CFieldNumber);
  for (size_t offset = 0; offset < mesh_bytes.size(); offset += kUploadPieceBytes) {
    reporter.Report("upload", double(offset) / double(mesh_bytes.size()));
    const size_t bytes = std::min(kUploadPieceBytes, mesh_bytes.size() - offset);
    if (!stream.Write(pieces.Make(mesh_bytes.subspan(offset, bytes)))) return;
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

absl::Status TellPlan(const v1::VoxelizationPlan& message, bool& planned,
                      const std::function<void(const Plan&)>& on_plan) {
  if (std::exchange(planned, true)) return absl::DataLossError("the server's result: a second plan");
  absl::StatusOr<Plan> plan = FromMessage(message);
  if (!plan.ok()) return plan.status();
  if (on_plan) on_plan(*plan);
  return absl::OkStatus();
}

// A small result in one message. An error means that the server violates the protocol, or is the sink's.
absl::Status TakeWhole(const v1::WholeResult& whole, ResultReader& reader, bool& planned, Reporter& reporter,
                       const std::function<void(const Plan&)>& on_plan) {
  absl::Status status = TellPlan(whole.accepted(), planned, on_plan);
  if (status.ok()) status = reader.AddWhole(whole);
  if (status.ok()) reporter.Report("download", 1);
  return status;
}

// Processes one message of any kind. An error means that the server violates the protocol, or is the sink's.
absl::Status Take(const v1::VoxelizeResponse& message, ResultReader& reader, bool& planned, Reporter& reporter,
                  const std::function<void(const Plan&)>& on_plan) {
  switch (message.message_case()) {
    case v1::VoxelizeResponse::kAccepted: return TellPlan(message.accepted(), planned, on_plan);
    case v1::VoxelizeResponse::kProgress:
      if (std::isnan(message.progress().fraction())) {
        return absl::DataLossError("the server's result: a progress that is no number");
      }
      reporter.Report(message.progress().stage(), message.progress().fraction());
      return absl::OkStatus();
    case v1::VoxelizeResponse::kHeader: return reader.AddHeader(message.header());
    case v1::VoxelizeResponse::kPiece: {
      absl::Status status = reader.AddPiece(message.piece());
      if (status.ok()) reporter.Report("download", reader.fraction());
      return status;
    }
    case v1::VoxelizeResponse::kSummary: return reader.AddSummary(message.summary());
    case v1::VoxelizeResponse::kWhole: return TakeWhole(message.whole(), reader, planned, reporter, on_plan);
    case v1::VoxelizeResponse::MESSAGE_NOT_SET: return absl::OkStatus();  // a message of a newer server
  }
  return absl::OkStatus();
}

// The same for a raw message.
absl::Status TakeBytes(grpc::ByteBuffer& buffer, PieceViewer& viewer, ResultReader& reader, bool& planned,
                       Reporter& reporter, const std::function<void(const Plan&)>& on_plan) {
  if (const PieceView* piece = viewer.View(buffer)) {
    absl::Status status = reader.AddPiece(*piece);
    if (status.ok()) reporter.Report("download", reader.fraction());
    return status;
  }
  v1::VoxelizeResponse message;
  if (!grpc::SerializationTraits<v1::VoxelizeResponse>::Deserialize(&buffer, &message).ok()) {
    return absl::DataLossError("the server's result: a message that cannot be read");
  }
  return Take(message, reader, planned, reporter, on_plan);
}

v1::VoxelizeConfig ConfigOf(const MeshSource& mesh, const VoxelizeRequest& request, const CallSettings& settings) {
  v1::VoxelizeConfig config = MakeConfig(request, mesh.type, settings);
  config.set_mesh_id(mesh.mesh_id);
  config.set_new_positions(!mesh.mesh_id.empty() && !mesh.bytes.empty());
  return config;
}

// The messages of one call, until its end. Out: an error of the server's messages or of the sink, otherwise the status
// of the call.
class Answer {
 public:
  Answer(const VoxelizeRequest& request, uint64_t max_result_bytes, const CallSettings& settings, ResultSink& sink,
         Reporter& reporter, const std::function<void(const Plan&)>& on_plan)
      : reader_(request, max_result_bytes, sink, settings.content_hash), reporter_(reporter), on_plan_(on_plan) {}

  // Reads all messages; after an error it cancels the call.
  template <typename Stream>
  void Read(grpc::ClientContext& context, Stream& stream) {
    PieceViewer viewer;
    grpc::ByteBuffer buffer;
    while (stream.Read(&buffer)) {
      if (broken_.ok()) broken_ = TakeBytes(buffer, viewer, reader_, planned_, reporter_, on_plan_);
      buffer.Clear();  // frees its memory for the next one
      if (!broken_.ok()) context.TryCancel();
    }
  }

  absl::StatusOr<RemoteRun> Take(const grpc::Status& status, const JobContext& job, const std::string& target) {
    if (!broken_.ok()) return broken_;
    if (!status.ok()) return CallStatus(status, job, target);
    return reader_.Take();
  }

 private:
  ResultReader reader_;
  Reporter& reporter_;
  const std::function<void(const Plan&)>& on_plan_;
  absl::Status broken_;
  bool planned_ = false;
};

grpc::ByteBuffer MeshRequest(const v1::VoxelizeConfig& config, std::span<const uint8_t> mesh_bytes) {
  google::protobuf::Arena arena;
  auto& message = *google::protobuf::Arena::CreateMessage<v1::VoxelizeMeshRequest>(&arena);
  *message.mutable_config() = config;
  message.set_mesh(mesh_bytes.data(), mesh_bytes.size());
  message.set_crc32c(Crc32c(mesh_bytes));
  return Serialized(message);
}

}  // namespace

absl::StatusOr<RemoteRun> CallVoxelizeTo(const RawCalls& calls, const std::string& target, uint64_t max_result_bytes,
                                         const CallSettings& settings, const MeshSource& mesh,
                                         const VoxelizeRequest& request, const JobContext& job, ResultSink& sink,
                                         const std::function<void(const Plan&)>& on_plan) {
  // In messages no target means one bit target; callers of this never mean that.
  if (request.targets.empty()) return absl::InvalidArgumentError("targets: at least one is needed");
  if (absl::Status status = job.Check(); !status.ok()) return status;
  grpc::ClientContext context;
  const CallWatch watch(context, job);
  Reporter reporter(job);
  Answer answer(request, max_result_bytes, settings, sink, reporter, on_plan);
  const v1::VoxelizeConfig config = ConfigOf(mesh, request, settings);
  if (mesh.bytes.size() <= kOneMessageBytes) {
    reporter.Report("upload", 0);
    const auto stream = calls.VoxelizeMesh(context, MeshRequest(config, mesh.bytes));
    answer.Read(context, *stream);
    return answer.Take(stream->Finish(), job, target);
  }
  const auto stream = calls.Voxelize(context);
  UploadThread upload(context, [&] { Upload(*stream, config, mesh.bytes, reporter); });
  answer.Read(context, *stream);
  upload.Join();
  return answer.Take(stream->Finish(), job, target);
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
