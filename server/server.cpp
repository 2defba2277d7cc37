#include "server.h"

#include <algorithm>
#include <future>
#include <thread>

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/resource_quota.h>
#include <unistd.h>

#include "absl/strings/str_cat.h"
#include "access/grpc_log.h"
#include "access/periodic.h"
#include "access/tls.h"
#include "base/machine.h"
#include "base/threads.h"
#include "check_files.h"
#include "io_threads.h"
#include "load/decode/foreign_decoders.h"
#include "observe/health_service.h"
#include "observe/http_endpoint.h"
#include "observe/idle_memory.h"
#include "observe/listen_socket.h"
#include "observe/log.h"
#include "observe/reflection_service.h"
#include "observe/unix_socket.h"
#include "pipeline/stages/backend.h"
#include "state/service_state.h"
#include "voxelization_service.h"
#include "web/web_endpoint.h"

namespace voxelpipe {
namespace {

// The interval of reading the limits of the container again.
constexpr std::chrono::milliseconds kMachineInterval{30'000};
// Write buffer of a stream beyond the flow-control window, used when the next message is known to follow
// (WriteOptions::set_buffer_hint): pieces smaller than this are sent several at a time.
constexpr int kWriteAheadBytes = 1 << 20;
constexpr int kKeepaliveMs = 60'000;  // detects vanished clients, so that their jobs end
constexpr int kMinPingIntervalMs =
    5'000;  // minimum interval of pings that clients may send to detect a vanished server

// Health calls are too frequent for the access log; refused ones are logged. They count as ended when they begin.
absl::Status HealthDoor(ServiceState& state, const grpc::CallbackServerContext& context, Rpc rpc) {
  const auto found = context.client_metadata().find("authorization");
  std::optional<std::string_view> authorization;
  if (found != context.client_metadata().end()) authorization.emplace(found->second.data(), found->second.size());
  std::string who;
  absl::Status status =
      state.access->Admit(authorization, rpc, CertificateOf(state, context), QuotaClock::now(), &who).status();
  state.metrics.CallBegan(rpc);
  state.metrics.CallEnded(rpc, status.code(), 0);
  if (!status.ok()) {
    LogLine line("health_refused");
    line.Add("peer", context.peer());
    if (!who.empty()) line.Add("client", who);
    line.Add("error", std::string_view(status.message().data(), status.message().size())).Write(LogLevel::kInfo);
  }
  return status;
}

// One line about the machine limits of the process, and the sizes derived from them.
void LogSizes(const MachineLimits& machine, const ServerOptions& resolved) {
  const auto mib = [](uint64_t bytes) { return absl::StrCat(bytes >> 20, " MiB"); };
  LogMessage(
      LogLevel::kInfo,
      absl::StrCat(ToString(machine), "; loaders ", resolved.loaders, ", CPU workers ", resolved.cpu_workers,
                   ", I/O threads ", resolved.io_threads, "; jobs ", mib(resolved.max_working_bytes), ", uploads ",
                   mib(resolved.max_upload_bytes), ", kept meshes ", mib(resolved.max_mesh_store_bytes)));
}

// For totals counted elsewhere.
void RaiseTo(prometheus::Counter& counter, uint64_t total) {
  if (const double missing = double(total) - counter.Value(); missing > 0) counter.Increment(missing);
}

// Gauges of the metrics that no other code updates.
void SampleState(ServiceState& state, const ServerTls& tls) {
  Metrics& metrics = state.metrics;
  metrics.upload_bytes.Set(double(state.uploads.used()));
  metrics.upload_limit_bytes.Set(double(state.uploads.limit()));
  metrics.working_bytes.Set(double(state.working.used()));
  metrics.working_limit_bytes.Set(double(state.working.limit()));
  const LruStats meshes = state.meshes.stats();
  metrics.mesh_store_bytes.Set(double(meshes.bytes));
  metrics.mesh_store_limit_bytes.Set(double(state.meshes.max_bytes()));
  metrics.mesh_store_meshes.Set(double(meshes.entries));
  RaiseTo(metrics.mesh_store_hits, meshes.hits);
  RaiseTo(metrics.mesh_store_misses, meshes.misses);
  RaiseTo(metrics.mesh_store_evictions, meshes.evictions);
  const LruStats results = state.results.cache().stats();
  metrics.result_cache_bytes.Set(double(results.bytes));
  metrics.result_cache_limit_bytes.Set(double(state.results.cache().max_bytes()));
  RaiseTo(metrics.result_cache_hits, results.hits);
  RaiseTo(metrics.result_cache_misses, results.misses);
  RaiseTo(metrics.result_cache_evictions, results.evictions);
  if (state.load_workers) {
    const LoadWorkers::Stats loading = state.load_workers->stats();
    metrics.load_workers.Set(double(loading.processes));
    metrics.load_workers_busy.Set(double(loading.busy));
    RaiseTo(metrics.isolated_loads, loading.questions);
    for (const auto& [reason, count] : loading.ended) RaiseTo(metrics.LoadWorkersEnded(reason), count);
  }
  if (const std::optional<TlsFacts> facts = tls.facts()) {
    metrics.certificate_expiry.Set(std::chrono::duration<double>(facts->valid_until.time_since_epoch()).count());
  }
}

// Warns of a certificate that is about to expire, at the start only; later the metric shows it.
void WarnOfCertificate(const std::string& path, const TlsFacts& facts) {
  constexpr std::chrono::hours kSoon(14 * 24);
  const auto now = std::chrono::system_clock::now();
  const auto left = std::chrono::duration_cast<std::chrono::hours>(facts.valid_until - now);
  if (facts.valid_from > now) LogMessage(LogLevel::kError, path + " is not valid yet: clients will refuse it");
  if (facts.valid_until < now) {
    LogMessage(LogLevel::kError, path + " has expired: clients will refuse it");
  } else if (left < kSoon) {
    LogMessage(LogLevel::kWarn, absl::StrCat(path, " expires in ", left.count(), " hours"));
  }
}

// gRPC does not say why, but the system does where another socket cannot be bound either.
absl::Status WhyNotListening(const std::string& listen) {
  const absl::StatusOr<ListenSocket> other = ListenOn(listen);
  if (!other.ok()) return other.status();
  close(other->descriptor);
  return absl::UnavailableError(absl::StrCat("cannot listen on ", listen));
}

}  // namespace

VoxelServer::VoxelServer(const ServerOptions& asked, const MachineLimits& machine,
                         std::unique_ptr<LoadWorkers> load_workers)
    : asked_(asked),
      machine_(machine),
      state_(std::make_unique<ServiceState>(Resolve(asked), std::move(load_workers))),
      service_(std::make_unique<VoxelizationServiceImpl>(*state_)),
      health_(std::make_unique<HealthService>([&state = *state_](const grpc::CallbackServerContext& context, Rpc rpc) {
        return HealthDoor(state, context, rpc);
      })) {}

absl::StatusOr<std::unique_ptr<VoxelServer>> VoxelServer::Start(const ServerOptions& options) {
  const MachineLimits machine = RefreshMachine();
  LimitThreadsToCpus();
  if (absl::Status s = CheckWebOptions(options); !s.ok()) return s;
  if (absl::Status s = CheckDevices(Resolve(options)); !s.ok()) return s;
  auto load_workers = StartLoadWorkers(Resolve(options));
  if (!load_workers.ok()) {
    return absl::Status(load_workers.status().code(),
                        absl::StrCat("--isolate-loading: ", load_workers.status().message()));
  }
  if (*load_workers != nullptr) ForbidForeignDecoders();  // from here on only the load workers run them
  std::unique_ptr<VoxelServer> server(new VoxelServer(options, machine, *std::move(load_workers)));
  LogSizes(machine, server->state_->options);
  auto access = AccessControl::Create(options.token_file, options.open_health, server->state_->metrics);
  if (!access.ok())
    return absl::Status(access.status().code(), absl::StrCat("--token-file: ", access.status().message()));
  server->state_->access = *std::move(access);
  TakeGrpcLog(server->state_->metrics);
  auto tls = ServerTls::Open(TlsOf(options), server->state_->metrics);
  if (!tls.ok()) return tls.status();
  server->tls_ = *std::move(tls);
  server->sampler_ =
      server->state_->metrics.BeforeText([&state = *server->state_, &tls = *server->tls_] { SampleState(state, tls); });

  if (!options.http_listen.empty()) {
    HealthService& health = *server->health_;
    auto http =
        HttpEndpoint::Start(options.http_listen, server->state_->metrics, [&health] { return health.serving(); });
    if (!http.ok()) return absl::Status(http.status().code(), absl::StrCat("--http-listen: ", http.status().message()));
    server->http_ = *std::move(http);
    server->http_address_ = server->http_->address();
  }
  if (const std::optional<TlsFacts> facts = server->tls_->facts()) WarnOfCertificate(options.tls_cert, *facts);
  // Once for the process, before any builder; idempotent.
  if (options.reflection) grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  if (options.reflection) {
    server->reflection_ = std::make_unique<ReflectionService>(std::vector<std::string>{
        v1::VoxelizationService::service_full_name(), grpc::health::v1::Health::service_full_name(),
        grpc::reflection::v1::ServerReflection::service_full_name(), "grpc.reflection.v1alpha.ServerReflection"});
  }
  std::string listen = options.listen;
  if (listen.starts_with(kUnixScheme)) {
    auto socket = UnixSocket::Prepare(listen);
    if (!socket.ok()) return socket.status();
    server->unix_socket_ = *std::move(socket);
    listen = server->unix_socket_->private_address();
  }
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(listen, server->tls_->Credentials(), &port);
  builder.RegisterService(server->service_.get());
  builder.RegisterService(server->health_.get());
  if (server->reflection_) builder.RegisterService(server->reflection_.get());
  builder.SetMaxReceiveMessageSize(kMaxMessageBytes);
  // gRPC would decompress a message of any size before it checks any limit.
  for (const auto algorithm : {GRPC_COMPRESS_DEFLATE, GRPC_COMPRESS_GZIP}) {
    builder.SetCompressionAlgorithmSupportStatus(algorithm, false);
  }
  // Buffers of gRPC itself.
  builder.SetResourceQuota(
      grpc::ResourceQuota("voxelpiped").Resize(size_t(server->state_->options.max_transport_bytes)));
  builder.AddChannelArgument(GRPC_ARG_HTTP2_WRITE_BUFFER_SIZE, kWriteAheadBytes);
  // Two servers must not share a port silently.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, int(options.max_connection_calls));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  if (options.max_connection_age_ms > 0) {
    builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, int(options.max_connection_age_ms));
  }
  if (options.max_connection_age_grace_ms > 0) {
    builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_GRACE_MS, int(options.max_connection_age_grace_ms));
  }
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kMinPingIntervalMs);
  server->server_ = builder.BuildAndStart();
  if (!server->server_ || port == 0) return WhyNotListening(options.listen);
  if (server->unix_socket_) {
    if (absl::Status s = server->unix_socket_->Publish(); !s.ok()) return s;
  }

  server->io_threads_ = std::make_unique<IoThreads>(size_t(server->state_->options.io_threads),
                                                    server->server_->InProcessChannel(grpc::ChannelArguments()));
  server->address_ = options.listen;
  if (!server->unix_socket_) {
    server->address_ = absl::StrCat(options.listen.substr(0, options.listen.rfind(':')), ":", port);
  }
  if (ListensBeyondLoopback(options.listen) && options.tls_cert.empty()) {
    LogMessage(LogLevel::kWarn,
               server->address_ + " may be reached from other machines, without encryption: TLS is off");
  }
  if (!options.web_listen.empty()) {
    if (absl::Status s = server->ServeWeb(); !s.ok()) return s;
  }
  server->reloader_ = std::make_unique<Periodic>(std::chrono::milliseconds(options.reload_interval_ms),
                                                 [&access = *server->state_->access, &tls = *server->tls_] {
                                                   access.ReloadIfChanged();
                                                   tls.ReloadIfChanged();
                                                 });
  if (const std::chrono::milliseconds unused(options.idle_memory_ms); unused.count() > 0) {
    const ServerOptions& resolved = server->state_->options;
    KeepFreedMemory(KeptBytesOfThread(machine.memory_bytes, resolved.loaders + resolved.cpu_workers));
    server->memory_looker_ = std::make_unique<Periodic>(
        unused, [unused, memory = std::make_shared<IdleMemory>(MemoryOfThisProcess())] { memory->Look(unused); });
  }
  server->machine_looker_ = std::make_unique<Periodic>(kMachineInterval, [it = server.get()] { it->FollowMachine(); });
  server->state_->pool.SetListener(
      [it = server.get()](const std::string& device, bool serving) { it->DeviceChanged(device, serving); });
  return server;
}

absl::Status VoxelServer::ServeWeb() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);  // of this server's own messages
  auto web = WebEndpoint::Start(*state_, server_->InProcessChannel(arguments));
  if (!web.ok()) return absl::Status(web.status().code(), absl::StrCat("--web-listen: ", web.status().message()));
  web_ = *std::move(web);
  web_address_ = web_->address();
  if (ListensBeyondLoopback(state_->options.web_listen)) {
    LogMessage(
        LogLevel::kWarn,
        absl::StrCat("http://", web_address_,
                     " may be reached from other machines, without encryption: a proxy with TLS belongs before it"));
  }
  return absl::OkStatus();
}

void VoxelServer::DeviceChanged(const std::string& device, bool serving) {
  const std::lock_guard lock(health_mutex_);
  health_->SetDevice(device, serving);
  if (serving) {
    serving_devices_.insert(device);
  } else {
    serving_devices_.erase(device);
  }
  if (!drained_) health_->SetServing(!serving_devices_.empty());
}

bool VoxelServer::Answers(std::chrono::milliseconds patience) {
  state_->metrics.Text();  // its samplers take the locks of the queue, the stores and the budgets
  // Shared with the callback, which may come late, or never.
  struct Call {
    grpc::ClientContext context;
    const grpc::Slice nothing;
    const grpc::ByteBuffer request{&nothing, 1};
    grpc::ByteBuffer response;
    std::promise<grpc::StatusCode> code;
  };
  const auto call = std::make_shared<Call>();
  grpc::GenericStub stub(server_->InProcessChannel(grpc::ChannelArguments()));
  // A method without a handler: it needs no token, and counts as no call.
  stub.UnaryCall(&call->context, "/voxelpipe.internal/Alive", {}, &call->request, &call->response,
                 [call](const grpc::Status& status) { call->code.set_value(status.error_code()); });
  std::future<grpc::StatusCode> code = call->code.get_future();
  return code.wait_for(patience) == std::future_status::ready && code.get() == grpc::StatusCode::UNIMPLEMENTED;
}

void VoxelServer::Drain() {
  machine_looker_.reset();  // it calls the server
  {
    const std::lock_guard lock(health_mutex_);
    drained_ = true;
    health_->SetServing(false);
  }
  const ServerOptions& options = state_->options;
  LogMessage(LogLevel::kInfo, absl::StrCat("draining: calls are taken for another ", options.lame_duck_ms,
                                           " ms, then those that run have ", options.drain_grace_ms, " ms"));
  std::this_thread::sleep_for(std::chrono::milliseconds(options.lame_duck_ms));
  // gRPC's own shutdown closes a connection as soon as its last call has been written; data that the client has not yet
  // read is lost when frames of the client meet the closed socket. So the calls end first; then the client acknowledges
  // the GOAWAY of the shutdown after all data sent before.
  const std::chrono::milliseconds grace(options.drain_grace_ms);
  const auto grace_end = std::chrono::system_clock::now() + grace;
  state_->gate.Close();
  const bool empty = state_->gate.WaitUntilEmpty(std::chrono::steady_clock::now() + grace);
  if (!empty) LogMessage(LogLevel::kWarn, "the calls that still run are ended now");
  if (web_) {
    web_->Drain(std::chrono::steady_clock::now() + (grace_end - std::chrono::system_clock::now()));
    web_.reset();  // and its channel, whose end the shutdown waits for
  }
  state_->pool.Hasten();  // no job runs any more, or the grace period is over
  health_->EndWatches();
  server_->Shutdown(empty ? grace_end : std::chrono::system_clock::now());
  server_->Wait();
  state_->scheduler.Drain();
  LogMessage(LogLevel::kInfo, "drained");
}

void VoxelServer::FollowMachine() {
  const std::lock_guard lock(machine_mutex_);
  const MachineLimits machine = RefreshMachine();
  if (machine == machine_) return;
  machine_ = machine;
  LimitThreadsToCpus();
  const ServerOptions resolved = Resolve(asked_);
  state_->Resize(resolved);
  io_threads_.reset();
  io_threads_ =
      std::make_unique<IoThreads>(size_t(resolved.io_threads), server_->InProcessChannel(grpc::ChannelArguments()));
  LogSizes(machine, resolved);
}

void VoxelServer::Reload() {
  FollowMachine();
  state_->access->Reload().IgnoreError();  // it is logged
}

VoxelServer::~VoxelServer() {
  machine_looker_.reset();  // it replaces the next one
  io_threads_.reset();
  StopTakingGrpcLog();
  if (state_) {
    state_->pool.SetListener({});
    state_->pool.Hasten();
  }
  if (server_ && !drained_) {
    health_->EndWatches();
    server_->Shutdown(std::chrono::system_clock::now());
    server_->Wait();
  }
  web_.reset();  // its calls have ended
  if (state_) state_->scheduler.Drain();
}

}  // namespace voxelpipe
