// Runs jobs on a server through the client library.
#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client.h"
#include "engine/report.h"
#include "engine/server_option.h"
#include "inspect.h"
#include "options/server_access.h"
#include "wire/status.h"

namespace voxelpipe::cli {
namespace {

// A server that is not there can be started; one that refuses a certificate is there.
absl::Status WithNextStep(const std::string& target, const absl::Status& status) {
  const std::string message(status.message());
  if (!IsConnectError(status) || message.find("refused") == std::string::npos) return status;
  absl::Status more(status.code(), absl::StrCat(message, "; 'voxelpiped --listen ", target, "' starts a server there"));
  status.ForEachPayload([&](const auto& url, const absl::Cord& payload) { more.SetPayload(url, payload); });
  return more;
}

absl::StatusOr<std::unique_ptr<Client>> ConnectTo(const std::string& target, int retries = 0) {
  absl::StatusOr<ConnectOptions> options = MakeConnectOptions();
  if (!options.ok()) return options.status();
  options->retries = retries;
  absl::StatusOr<std::unique_ptr<Client>> client = Client::Connect(target, *options);
  if (client.ok()) return client;
  return WithNextStep(target, client.status());
}

class RemoteEngine : public Engine {
 public:
  RemoteEngine(std::string target, int retries) : target_(std::move(target)), retries_(retries) {}

  absl::StatusOr<EngineRun> Run(MeshInputs meshes, const VoxelizeRequest& request, int repeat, JobContext& job,
                                ResultSink& sink, VoxelizeResult* whole) override {
    // Sibling files are packed in: the server cannot read this machine's disk.
    if (absl::Status status = Connect(); !status.ok()) return status;
    EngineRun run;
    run.server_peak_bytes = 0;
    const auto add = [&](RemoteRun& remote) {
      run.mesh_stages = std::move(remote.mesh_stages);
      run.runs.push_back(std::move(remote.stats));
      run.served = {remote.served.worker,   remote.served.queue_ms, remote.served.batch_jobs,
                    remote.served.attempts, remote.cached,          remote.sent_bytes};
      run.server_peak_bytes = std::max(*run.server_peak_bytes, remote.peak_bytes);
      if (request.fill != Fill::kNone) run.open_edges = remote.report.open_edges;
    };
    Source source(*client_, std::move(meshes), request, job);
    if (repeat == 1 && whole == nullptr) {
      absl::StatusOr<RemoteRun> remote = source.RunTo(sink);
      if (!remote.ok()) return remote.status();
      add(*remote);
      return run;
    }
    VoxelizeResult last;
    for (int i = 0; i < repeat; ++i) {
      last = VoxelizeResult();  // freed before the next one arrives: one result in memory at a time
      absl::StatusOr<RemoteResult> remote = source.Run();
      if (!remote.ok()) return remote.status();
      last = std::move(remote->result);
      add(*remote);
    }
    if (absl::Status status = WriteTo(last, sink); !status.ok()) return status;
    if (whole != nullptr) *whole = std::move(last);
    return run;
  }

  absl::StatusOr<std::vector<ShaderInfo>> Shaders() override {
    if (absl::Status status = Connect(); !status.ok()) return status;
    return client_->ListShaders();
  }

 private:
  // The mesh of a run: one file, which goes with each call; or several meshes, which the server keeps.
  class Source {
   public:
    Source(Client& client, MeshInputs meshes, const VoxelizeRequest& request, const JobContext& job)
        : client_(client), meshes_(std::move(meshes)), request_(request), job_(job) {}

    absl::StatusOr<RemoteResult> Run() {
      const MeshInput& mesh = meshes_.files[0];
      if (meshes_.placed.empty()) return client_.Voxelize(mesh.bytes, mesh.type, request_, job_);
      return OfStored<RemoteResult>([&](const auto& placed) { return client_.VoxelizePlaced(placed, request_, job_); });
    }
    absl::StatusOr<RemoteRun> RunTo(ResultSink& sink) {
      const MeshInput& mesh = meshes_.files[0];
      if (meshes_.placed.empty()) return client_.VoxelizeTo(mesh.bytes, mesh.type, request_, job_, sink);
      return OfStored<RemoteRun>(
          [&](const auto& placed) { return client_.VoxelizePlacedTo(placed, request_, job_, sink); });
    }

   private:
    // Uploads the files, unless the server has them, and calls with their names. A second time if the server dropped
    // one of them in between.
    template <typename Reply, typename Call>
    absl::StatusOr<Reply> OfStored(const Call& call) {
      for (bool again = false;; again = true) {
        std::vector<std::string> names;
        for (const MeshInput& file : meshes_.files) {
          absl::StatusOr<StoredMesh> stored = client_.UploadMesh(file.bytes, file.type, job_);
          if (!stored.ok()) return stored.status();
          names.push_back(std::move(stored->name));
        }
        std::vector<PlacedStored> placed;
        for (const PlacedInput& input : meshes_.placed) {
          const PlacedMesh& p = input.placement;
          placed.push_back({names[input.file], p.matrix, p.name, p.label, p.priority, p.motion});
        }
        absl::StatusOr<Reply> reply = call(placed);
        if (again || !absl::IsNotFound(reply.status())) return reply;
      }
    }

    Client& client_;
    const MeshInputs meshes_;
    const VoxelizeRequest& request_;
    const JobContext& job_;
  };

  absl::Status Connect() {
    if (client_ != nullptr) return absl::OkStatus();
    absl::StatusOr<std::unique_ptr<Client>> client = ConnectTo(target_, retries_);
    if (!client.ok()) return client.status();
    client_ = *std::move(client);
    return absl::OkStatus();
  }

  std::string target_;
  int retries_;
  std::unique_ptr<Client> client_;
};

nlohmann::ordered_json ServerJson(const ServerDescription& server) {
  nlohmann::ordered_json backends = nlohmann::ordered_json::array();
  for (const ServerBackend& backend : server.backends) {
    backends.push_back({{"name", backend.name}, {"simd", backend.simd}});
  }
  nlohmann::ordered_json devices = nlohmann::ordered_json::array();
  for (const ServerDevice& device : server.devices) {
    devices.push_back({{"name", device.name},
                       {"backend", device.backend},
                       {"model", device.model},
                       {"memory_bytes", device.memory_bytes},
                       {"workers", device.workers},
                       {"state", device.serving ? "serving" : "quarantined"},
                       {"reason", device.reason}});
  }
  return {{"version", server.version},
          {"backends", backends},
          {"devices", devices},
          {"loaders", server.workers},
          {"workers", server.workers},  // its former name
          {"threads", server.threads},
          {"limits",
           {{"max_queue", server.max_queue},
            {"max_file_bytes", server.max_file_bytes},
            {"max_triangles", server.max_triangles},
            {"max_result_bytes", server.max_result_bytes},
            {"max_working_bytes", server.max_working_bytes},
            {"max_message_bytes", server.max_message_bytes},
            {"max_mesh_store_bytes", server.max_mesh_store_bytes}}}};
}

Lines ServerTable(const std::string& target, const ServerDescription& server) {
  Lines table = {absl::StrCat(target, ": voxelpiped ", server.version)};
  const auto row = [&](const char* name, const std::string& text) { table.push_back(TableRow(name, text, 16)); };
  const auto limit = [](uint64_t value, const std::string& text) { return value == 0 ? std::string("none") : text; };
  std::string backends;
  for (const ServerBackend& backend : server.backends) {
    absl::StrAppend(&backends, backends.empty() ? "" : ", ", backend.name, " (", backend.simd, ")");
  }
  row("backends", backends);
  for (const ServerDevice& device : server.devices) {
    row("device",
        absl::StrCat(device.name, device.model.empty() ? "" : ", ", device.model, device.memory_bytes == 0 ? "" : ", ",
                     device.memory_bytes == 0 ? "" : HumanBytes(device.memory_bytes), ", ", device.workers,
                     device.workers == 1 ? " worker" : " workers",
                     device.serving ? "" : absl::StrCat(", quarantined: ", device.reason)));
  }
  row("concurrency",
      absl::StrCat("a batch of requests a worker, ", server.workers, server.workers == 1 ? " mesh" : " meshes",
                   " loaded; ", server.threads, " CPU threads"));
  row("waiting", limit(server.max_queue, absl::StrCat("up to ", server.max_queue, " requests")));
  row("largest file", limit(server.max_file_bytes, HumanBytes(server.max_file_bytes)));
  row("most triangles", limit(server.max_triangles, WithCommas(server.max_triangles)));
  row("largest result", limit(server.max_result_bytes, HumanBytes(server.max_result_bytes)));
  row("working memory", limit(server.max_working_bytes, HumanBytes(server.max_working_bytes)));
  row("largest message", limit(server.max_message_bytes, HumanBytes(server.max_message_bytes)));
  row("kept meshes", limit(server.max_mesh_store_bytes, HumanBytes(server.max_mesh_store_bytes)));
  return table;
}

}  // namespace

std::unique_ptr<Engine> MakeRemoteEngine(const std::string& target, int retries) {
  return std::make_unique<RemoteEngine>(target, retries);
}

absl::StatusOr<MeshFacts> RemoteFacts(const std::string& target, const std::string& path, const MeshReading& reading,
                                      const JobContext& job) {
  absl::StatusOr<MeshInput> mesh = ReadMeshInput(path, reading, job);
  if (!mesh.ok()) return mesh.status();
  const absl::StatusOr<ConnectOptions> options = MakeConnectOptions();
  if (!options.ok()) return options.status();
  absl::StatusOr<MeshInspection> seen = InspectMesh(target, *options, mesh->bytes, mesh->type, job);
  if (!seen.ok()) return WithNextStep(target, seen.status());
  WarningList warnings = std::move(mesh->warnings);
  warnings.Append(seen->warnings);
  return MeshFacts{seen->report, std::move(seen->contents), std::move(warnings), std::move(seen->stages)};
}

std::optional<std::chrono::milliseconds> RetryDelayOf(const absl::Status& status) {
  return RetryDelay(status);
}

bool CouldNotConnect(const absl::Status& status) {
  return IsConnectError(status);
}

absl::StatusOr<Lines> DescribeServer(const std::string& target, bool json) {
  const absl::StatusOr<std::unique_ptr<Client>> client = ConnectTo(target);
  if (!client.ok()) return client.status();
  const absl::StatusOr<ServerDescription> server = (*client)->ServerInfo();
  if (!server.ok()) return server.status();
  return json ? Lines{JsonText(ServerJson(*server))} : ServerTable(target, *server);
}

}  // namespace voxelpipe::cli
