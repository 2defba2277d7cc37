// What loading in processes of its own costs: the same calls to a server with --isolate-loading on and to one with off,
// in turns, and the medians of both. The machine should be quiet.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "support/meshes/compressed_meshes.h"

namespace voxelpipe::testing {
namespace {

struct Case {
  const char* name;
  std::vector<uint8_t> file;
  int rounds;
};

double CallMs(Client& client, const std::vector<uint8_t>& file) {
  VoxelizeRequest request;
  request.grid.resolution = 128;
  const JobContext job;
  const auto begin = std::chrono::steady_clock::now();
  const auto result = client.Voxelize(file, MeshFormat::kAuto, request, job);
  const std::chrono::duration<double, std::milli> ms = std::chrono::steady_clock::now() - begin;
  if (!result.ok()) {
    std::fprintf(stderr, "%s\n", std::string(result.status().message()).c_str());
    std::exit(1);
  }
  return ms.count();
}

double Median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + ptrdiff_t(values.size() / 2), values.end());
  return values[values.size() / 2];
}

int Main(int argc, char** argv) {
  const int scale = argc > 1 ? std::max(1, std::atoi(argv[1])) : 100;  // percent of the rounds
  auto on = ServerProcess::Start({"--isolate-loading", "on", "--log-level", "warn"});
  auto off = ServerProcess::Start({"--isolate-loading", "off", "--log-level", "warn"});
  if (!on.ok() || !off.ok()) return 1;
  const auto with = Client::Connect((*on)->address()), without = Client::Connect((*off)->address());
  if (!with.ok() || !without.ok()) return 1;
  const Shape small = TorusShape(16, 16), large = TorusShape(707, 707);  // 512 and 999,698 triangles
  const std::vector<Case> cases = {
      {"draco, 512 triangles", DracoFile(small), 2000},  {"draco glb, 512 triangles", DracoGlb(small), 2000},
      {"plain glb, 512 triangles", TorusGlb(16), 2000},  {"draco, 1 M triangles", DracoFile(large), 60},
      {"draco glb, 1 M triangles", DracoGlb(large), 60}, {"meshopt, 1 M triangles", MeshoptGlb(large), 100}};
  std::printf("%-26s %10s %10s %10s %8s\n", "mesh", "off ms", "on ms", "more ms", "more");
  for (const Case& c : cases) {
    std::vector<double> ms[2], more;
    const int rounds = std::max(3, c.rounds * scale / 100);
    for (int i = -3; i < rounds; ++i) {
      double took[2];
      // Who is first changes.
      for (const int turn : {0, 1}) {
        const int which = (turn + i) & 1;
        took[which] = CallMs(which == 1 ? **with : **without, c.file);
      }
      if (i < 0) continue;
      ms[0].push_back(took[0]);
      ms[1].push_back(took[1]);
      more.push_back(took[1] - took[0]);
    }
    const double base = Median(ms[0]);
    std::printf("%-26s %10.3f %10.3f %10.3f %7.1f%%\n", c.name, base, Median(ms[1]), Median(more),
                100 * Median(more) / base);
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace
}  // namespace voxelpipe::testing

int main(int argc, char** argv) {
  return voxelpipe::testing::Main(argc, argv);
}
