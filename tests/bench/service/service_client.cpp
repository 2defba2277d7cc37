// service_client SERVER SERVER_PID MESH SECONDS [CA_FILE]: what the C++ client makes of a server's bytes, one JSON
// object.
//   "result": dense 512^3 u8 from the server's cache (--result-cache-bytes), to memory, checked by CRC-32C; "hashed":
//   by SHA-256 too.
//   "upload": sending all bytes of the mesh by UploadMesh; the mesh is deleted in between.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "bench/service/cpu_clock.h"
#include "client.h"
#include "load/pack.h"

namespace voxelpipe::bench {
namespace {

using Clock = std::chrono::steady_clock;

// Runs `once`, which returns bytes or nothing, for so long. Out: what it took, and how often it ran.
template <typename Once>
Measured Repeat(pid_t server, double seconds, Once once) {
  once();  // warm
  const Span span(server);
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  double runs = 0, bytes = 0;
  do {
    const double more = once();
    if (more == 0) return {};
    bytes += more;
    ++runs;
  } while (Clock::now() < end);
  return span.End(runs, bytes);
}

void Print(const char* name, const Measured& m, const char* end) {
  std::printf(
      "\"%s\": {\"gigabytes_per_second\": %.4f, \"server_cpu_s_per_gb\": %.4f, \"client_cpu_s_per_gb\": %.4f}%s", name,
      m.gigabytes_per_second(), m.server_cpu / m.bytes * 1e9, m.client_cpu / m.bytes * 1e9, end);
}

VoxelizeRequest Dense() {
  VoxelizeRequest request;
  request.grid.resolution = 512;
  request.grid.fit = GridFit::kCube;
  request.targets[0].format = VoxelFormat::kU8;
  request.targets[0].blend = Blend::kReplace;
  request.targets[0].shader = {.name = "constant", .parameters = {}};
  return request;
}

int Main(int argc, char** argv) {
  if (argc < 5) return std::fputs("service_client SERVER SERVER_PID MESH SECONDS [CA_FILE]\n", stderr), 2;
  const pid_t server = std::atoi(argv[2]);
  const double seconds = std::atof(argv[4]);
  const absl::StatusOr<PackedMesh> mesh = ReadAndPackMeshFile(argv[3]);
  ConnectOptions options;
  if (argc > 5) options.tls = ClientTls{argv[5], "", "", ""};
  options.settings.content_hash = false;
  const auto plain = Client::Connect(argv[1], options);
  options.settings.content_hash = true;
  const auto hashed = Client::Connect(argv[1], options);
  if (!mesh.ok() || !plain.ok() || !hashed.ok()) return std::fputs("service_client: no mesh or no server\n", stderr), 1;
  const auto stored = (*plain)->UploadMesh(mesh->bytes, mesh->format, JobContext());
  if (!stored.ok()) return std::fputs("service_client: the mesh was refused\n", stderr), 1;

  const auto voxelize = [&](Client& client) {
    const absl::StatusOr<RemoteResult> remote = client.VoxelizeStored(stored->name, Dense(), JobContext());
    return remote.ok() ? double(remote->sent_bytes) : 0;
  };
  std::printf("{");
  Print("result", Repeat(server, seconds, [&] { return voxelize(**plain); }), ", ");
  Print("hashed", Repeat(server, seconds, [&] { return voxelize(**hashed); }), ", ");

  // The time of the bytes' way alone: what comes before and after it, their SHA-256 and the mesh's loading, is not the
  // stream's.
  Measured way;
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  do {
    if (!(*plain)->ReleaseMesh(stored->name).ok()) break;
    std::vector<std::pair<Clock::time_point, double>> told;
    JobContext job([&](std::string_view, double fraction) { told.emplace_back(Clock::now(), fraction); });
    if (!(*plain)->UploadMesh(*mesh, MeshFormat::kAuto, job).ok() || told.size() < 3) break;
    const auto& last = told[told.size() - 2];  // told before the last piece is written
    way.seconds += std::chrono::duration<double>(last.first - told.front().first).count();
    way.bytes += last.second * double(mesh->size());
  } while (Clock::now() < end);
  Print("upload", way, "}\n");
  return 0;
}

}  // namespace
}  // namespace voxelpipe::bench

int main(int argc, char** argv) {
  return voxelpipe::bench::Main(argc, argv);
}
