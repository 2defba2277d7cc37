#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <functional>
#include <thread>

#include <sys/resource.h>

#include <google/protobuf/message_lite.h>
#include <grpcpp/client_context.h>

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32c.h"
#include "bench/answer.h"
#include "bench/lane.h"
#include "bench/load.h"
#include "channel.h"
#include "engine/interrupt.h"
#include "grid/grid_spec.h"
#include "options/server_access.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/duration.h"
#include "wire/request.h"
#include "wire/status.h"

namespace voxelpipe::cli {
namespace {

using v1::VoxelizationService;

constexpr size_t kPieceBytes = size_t{1} << 20;
constexpr size_t kOneMessageBytes = size_t{1} << 20;    // of a mesh sent in one message with its request
constexpr std::chrono::milliseconds kPollInterval{20};  // poll interval for signals, while idle

absl::Status AtServer(const std::string& target, const grpc::Status& status) {
  if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) return OtherContractError(target);
  const absl::Status ours = FromGrpcStatus(status);
  return {ours.code(), absl::StrCat(target, ": ", std::string(ours.message()))};
}

grpc::ByteBuffer Serialized(const google::protobuf::MessageLite& message) {
  const std::string bytes = message.SerializeAsString();
  const grpc::Slice slice(bytes);
  return {&slice, 1};
}

// All but the mesh.
v1::VoxelizeRequest RequestOf(const LoadPlan& plan) {
  v1::VoxelizeRequest request = MakeRequest(plan.request);
  v1::Execution& execution = *request.mutable_execution();
  if (plan.priority == "high") execution.set_priority(v1::PRIORITY_HIGH);
  if (plan.priority == "normal") execution.set_priority(v1::PRIORITY_NORMAL);
  if (plan.priority == "low") execution.set_priority(v1::PRIORITY_LOW);
  if (plan.queue_timeout_ms) {
    WriteTo(std::chrono::milliseconds(*plan.queue_timeout_ms), *execution.mutable_queue_timeout());
  }
  if (plan.fallback) execution.set_fallback(*plan.fallback);
  v1::Delivery& delivery = *request.mutable_delivery();
  if (plan.without_hash) delivery.set_content_hash(false);
  if (plan.compression == "none") delivery.set_compression(v1::COMPRESSION_NONE);
  if (plan.compression == "zstd") delivery.set_compression(v1::COMPRESSION_ZSTD);
  return request;
}

// Out: the name of the mesh.
absl::StatusOr<std::string> UploadMesh(VoxelizationService::Stub& stub, const std::string& target,
                                       const FileBytes& mesh, MeshFileType type) {
  grpc::ClientContext context;
  v1::Mesh response;
  const std::unique_ptr<grpc::ClientWriter<v1::UploadMeshRequest>> writer = stub.UploadMesh(&context, &response);
  v1::UploadMeshRequest message;
  message.mutable_upload()->set_format(ToMessage(type.format));
  message.mutable_upload()->set_unit(ToMessage(type.unit));
  bool open = writer->Write(message);
  for (size_t offset = 0; open && offset < mesh.size(); offset += kPieceBytes) {
    const size_t bytes = std::min(kPieceBytes, mesh.size() - offset);
    message.set_piece(mesh.data() + offset, bytes);
    message.set_crc32c(Crc32c({mesh.data() + offset, bytes}));
    open = writer->Write(message);
  }
  writer->WritesDone();
  const grpc::Status status = writer->Finish();
  if (!status.ok()) return AtServer(target, status);
  return response.name();
}

// The messages of one VoxelizeUpload call.
std::vector<v1::VoxelizeUploadRequest> CallMessages(const v1::VoxelizeRequest& request, const FileBytes& mesh) {
  std::vector<v1::VoxelizeUploadRequest> messages(1);
  *messages[0].mutable_request() = request;
  for (size_t offset = 0; offset < mesh.size(); offset += kPieceBytes) {
    messages.emplace_back().set_piece(mesh.data() + offset, std::min(kPieceBytes, mesh.size() - offset));
  }
  return messages;
}

// `mesh`: empty with a stored mesh.
v1::VoxelizeRequest WithMesh(v1::VoxelizeRequest request, const FileBytes& mesh) {
  if (!mesh.empty()) request.mutable_mesh()->mutable_bytes()->set_data(mesh.data(), mesh.size());
  return request;
}

// Requests that differ, although they give the same bytes: a server could share one run among equal requests, and the
// load would measure that. They differ in the fill value, which has no effect without a fill.
std::vector<LoadRun::Variant> MakeVariants(const LoadPlan& plan, v1::VoxelizeRequest request, const FileBytes& mesh,
                                           const std::string& call) {
  constexpr size_t kMaxWithMesh = 64, kMaxVariants = 4096;
  const size_t at_once = size_t(plan.rate ? plan.max_in_flight : plan.concurrency);
  size_t count = std::min(mesh.empty() ? kMaxVariants : kMaxWithMesh, std::max<size_t>(64, 2 * at_once));
  if (plan.same_request || plan.request.fill != Fill::kNone) count = 1;
  std::vector<LoadRun::Variant> variants(count);
  for (size_t i = 0; i < count; ++i) {
    if (count > 1) {
      v1::RenderTarget& target = *request.mutable_spec()->mutable_targets(0);
      target.clear_fill();
      target.add_fill(1 + double(i));
    }
    if (plan.many) {
      v1::BatchJob job;
      *job.mutable_request() = WithMesh(request, mesh);
      variants[i].push_back(Serialized(job));
      continue;
    }
    if (call == "mesh") {
      variants[i].push_back(Serialized(WithMesh(request, mesh)));
      continue;
    }
    std::vector<v1::VoxelizeUploadRequest> messages = CallMessages(request, i == 0 ? mesh : FileBytes());
    for (const v1::VoxelizeUploadRequest& message : messages) variants[i].push_back(Serialized(message));
    // The pieces after the request are the same bytes, stored once.
    for (size_t piece = messages.size(); piece < variants[0].size(); ++piece) variants[i].push_back(variants[0][piece]);
  }
  return variants;
}

// A valid response.
absl::StatusOr<Answer> Complete(Answer answer, const std::string& target) {
  Outcome outcome;
  answer.Fill("", outcome);
  if (outcome.code != absl::StatusCode::kOk) {
    return absl::DataLossError(absl::StrCat(target, ": the response ended early"));
  }
  return answer;
}

// Reads the response of a call before the measurement, to its end.
template <typename Stream>
absl::StatusOr<Answer> ReadAnswer(Stream& stream, const std::string& target) {
  Answer answer;
  absl::Status broken = absl::OkStatus();
  v1::VoxelizeResponse message;
  while (stream.Read(&message)) {
    if (broken.ok()) broken = answer.Take(message);
  }
  const grpc::Status status = stream.Finish();
  if (!status.ok()) return AtServer(target, status);
  if (!broken.ok()) return broken;
  return Complete(std::move(answer), target);
}

// One VoxelizeUpload call before the measurement. Out: its response.
absl::StatusOr<Answer> StreamOnce(VoxelizationService::Stub& stub, const std::string& target,
                                  const std::vector<v1::VoxelizeUploadRequest>& messages) {
  grpc::ClientContext context;
  const auto stream = stub.VoxelizeUpload(&context);
  std::thread writer([&] {
    for (const v1::VoxelizeUploadRequest& message : messages) {
      if (!stream->Write(message)) return;
    }
    stream->WritesDone();
  });
  absl::StatusOr<Answer> answer = ReadAnswer(*stream, target);
  writer.join();
  return answer;
}

double CpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) { return double(time.tv_sec) + double(time.tv_usec) * 1e-6; };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

// CPU time of a local process, including ended threads.
absl::StatusOr<double> CpuSecondsOf(int pid) {
  std::ifstream file(absl::StrCat("/proc/", pid, "/stat"));
  std::string text;
  std::getline(file, text);
  // The name of the program, in brackets, may contain any character; the fields after it are numbers.
  const size_t close = text.rfind(')');
  unsigned long user = 0, system = 0;  // NOLINT(google-runtime-int): scanf's own
  if (close == std::string::npos ||
      std::sscanf(text.c_str() + close + 1, " %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %lu %lu", &user, &system) !=
          2) {
    return absl::NotFoundError(absl::StrCat("--server-pid: there is no process ", pid));
  }
  return double(user + system) / double(sysconf(_SC_CLK_TCK));
}

class Servers {
 public:
  // Connects, uploads, and sends one request to each server.
  absl::Status Prepare(const LoadPlan& plan, LoadRun& run, LoadResult& result) {
    const absl::StatusOr<ConnectOptions> options = MakeConnectOptions();
    if (!options.ok()) return options.status();
    const int connections = plan.connections > 0 ? plan.connections : int(plan.servers.size());
    for (int i = 0; i < std::max(connections, int(plan.servers.size())); ++i) {
      const std::string& target = plan.servers[size_t(i) % plan.servers.size()];
      absl::StatusOr<std::shared_ptr<grpc::Channel>> channel = OpenChannel(target, *options);
      if (!channel.ok()) return channel.status();
      channels.push_back(*std::move(channel));
    }
    v1::VoxelizeRequest request = RequestOf(plan);
    result.mesh_sent = plan.send_mesh;
    if (result.mesh_sent) {
      WriteTo(plan.mesh_type, *request.mutable_mesh()->mutable_bytes());
    } else {
      for (size_t i = 0; i < plan.servers.size(); ++i) {
        VoxelizationService::Stub stub(channels[i]);
        const absl::StatusOr<std::string> name = UploadMesh(stub, plan.servers[i], plan.mesh, plan.mesh_type);
        if (!name.ok()) return name.status();
        request.mutable_mesh()->mutable_stored()->set_name(*name);  // the same on all: of the mesh's bytes
      }
    }
    const FileBytes none;
    const FileBytes& mesh = result.mesh_sent ? plan.mesh : none;
    const bool in_one = mesh.size() <= kOneMessageBytes && !plan.stream && !plan.many;
    for (size_t i = 0; i < plan.servers.size(); ++i) {
      VoxelizationService::Stub stub(channels[i]);
      grpc::ClientContext context;
      const absl::StatusOr<Answer> answer =
          in_one ? ReadAnswer(*stub.Voxelize(&context, WithMesh(request, mesh)), plan.servers[i])
                 : StreamOnce(stub, plan.servers[i], CallMessages(request, mesh));
      if (!answer.ok()) return answer.status();
      result.hash = answer->summary().content_sha256();
      result.bytes = answer->bytes();
      if (i > 0 && result.hash != run.expected_hash) {
        return absl::DataLossError(absl::StrCat(plan.servers[i], " gives other bytes than ", plan.servers[0]));
      }
      run.expected_hash = result.hash;
    }
    result.call = plan.many ? "many" : in_one ? "mesh" : "stream";
    run.method =
        in_one ? "/voxelpipe.v1.VoxelizationService/Voxelize" : "/voxelpipe.v1.VoxelizationService/VoxelizeUpload";
    run.variants = MakeVariants(plan, request, mesh, result.call);
    result.connections = int(channels.size());
    return absl::OkStatus();
  }

  std::vector<std::shared_ptr<grpc::Channel>> channels;
};

class Loop {
 public:
  Loop(const LoadPlan& plan, LoadRun& run, std::vector<std::unique_ptr<Lane>>& lanes)
      : plan_(plan), run_(run), lanes_(lanes) {}

  // Both return at the end of the window, or on a signal, and call `at_begin` at its start.
  void Closed(const std::function<void()>& at_begin) {
    for (int i = 0; i < plan_.concurrency; ++i) lanes_[size_t(i) % lanes_.size()]->Start(LoadClock::now());
    WaitUntil(run_.begin);
    at_begin();
    WaitUntil(run_.end);
  }

  void Open(LoadClock::time_point begin, std::function<void()> at_begin) {
    ArrivalSchedule schedule(*plan_.rate, plan_.arrivals, plan_.seed);
    for (size_t i = 0;; ++i) {
      const LoadClock::time_point due = begin + schedule.Next();
      if (due >= run_.end || !WaitUntil(due)) break;
      while (run_.in_flight.load(std::memory_order_acquire) >= plan_.max_in_flight) {
        if (InterruptSignal() != 0) return;
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
      if (at_begin && due >= run_.begin) std::exchange(at_begin, nullptr)();
      lanes_[i % lanes_.size()]->Start(due);
    }
    WaitUntil(run_.end);
  }

  void Drain() {
    run_.stop = true;
    while (run_.in_flight.load(std::memory_order_acquire) > 0) {
      if (InterruptSignal() != 0) run_.cancel = true;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

 private:
  // False on a signal.
  static bool WaitUntil(LoadClock::time_point time) {
    for (LoadClock::time_point now = LoadClock::now(); now < time; now = LoadClock::now()) {
      if (InterruptSignal() != 0) return false;
      std::this_thread::sleep_until(std::min(time, now + kPollInterval));
    }
    return InterruptSignal() == 0;
  }

  const LoadPlan& plan_;
  LoadRun& run_;
  std::vector<std::unique_ptr<Lane>>& lanes_;
};

double Seconds(LoadClock::duration time) {
  return std::chrono::duration<double>(time).count();
}

}  // namespace

absl::StatusOr<LoadResult> RunLoad(const LoadPlan& plan) {
  if (plan.server_pid) {
    if (const absl::StatusOr<double> cpu = CpuSecondsOf(*plan.server_pid); !cpu.ok()) return cpu.status();
  }
  if (absl::Status status = CheckGridRequest(plan.request.grid); !status.ok()) return status;
  LoadResult result;
  LoadRun run;
  Servers servers;
  if (absl::Status status = servers.Prepare(plan, run, result); !status.ok()) return status;

  run.closed_loop = !plan.rate;
  run.honour_retry = plan.honour_retry;
  run.deadline = plan.deadline;
  const auto seconds = [](double value) {
    return std::chrono::duration_cast<LoadClock::duration>(std::chrono::duration<double>(value));
  };
  const LoadClock::time_point begin = LoadClock::now();
  run.begin = begin + seconds(plan.warmup_seconds);
  run.end = run.begin + seconds(plan.seconds);
  std::vector<std::unique_ptr<Lane>> lanes;
  for (const std::shared_ptr<grpc::Channel>& channel : servers.channels) {
    lanes.push_back(plan.many ? MakeManyLane(channel, run) : MakeCallLane(channel, run));
  }
  Loop loop(plan, run, lanes);
  double client_cpu = 0, server_cpu = 0;
  const auto read_clocks = [&] {
    client_cpu = CpuSeconds();
    if (plan.server_pid) server_cpu = CpuSecondsOf(*plan.server_pid).value_or(0);
  };
  read_clocks();
  if (run.closed_loop) {
    loop.Closed(read_clocks);
  } else {
    loop.Open(begin, read_clocks);
  }
  const LoadClock::time_point issued = std::min(LoadClock::now(), run.end);
  loop.Drain();
  result.client_cpu_seconds = CpuSeconds() - client_cpu;
  if (plan.server_pid) {
    const absl::StatusOr<double> now = CpuSecondsOf(*plan.server_pid);
    if (now.ok()) result.server_cpu_seconds = *now - server_cpu;
  }
  LoadClock::time_point last = issued;
  for (const std::unique_ptr<Lane>& lane : lanes) {
    const Lane::Ended ended = lane->End();
    result.tally.Merge(ended.tally);
    last = std::max(last, ended.last_answer);
  }
  result.issue_seconds = std::max(0.0, Seconds(issued - run.begin));
  result.drain_seconds = Seconds(last - issued);
  result.interrupted = InterruptSignal() != 0;
  return result;
}

}  // namespace voxelpipe::cli
