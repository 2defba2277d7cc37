// Every CUDA device under several threads at once, and lost and back: by the public entry points, each result beside
// the CPU's.
//
// Exit: 0 all as it should be, 1 something is not, 77 no CUDA device.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "base/device_failure.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

int wrong = 0;

void Expect(bool right, const std::string& what) {
  std::printf("%s: %s\n", right ? "ok   " : "WRONG", what.c_str());
  std::fflush(stdout);
  wrong += !right;
}

// Different meshes, kinds and sizes.
struct Jobs {
  std::vector<TriangleMesh> meshes;
  std::vector<VoxelizeRequest> requests;
  std::vector<std::vector<std::vector<uint8_t>>> expected;  // arrays of each

  Jobs() {
    for (uint32_t i = 0; i < 12; ++i) {
      meshes.push_back(i % 2 == 0 ? testing::BumpySphere(int(24 + 8 * i), i + 1) : testing::Soup(2000, 20, i + 1));
      if (i % 3 == 0) meshes.back().content_id = "job" + std::to_string(i);
      VoxelizeRequest request;
      request.grid.resolution = 40 + 24 * int64_t{i};
      if (i % 4 == 1) request.fill = Fill::kParity;
      if (i % 4 == 2) request.result = ResultKind::kSparse;
      if (i % 4 == 3) request.result = ResultKind::kBuckets;
      if (i >= 6) {
        request.targets[0].format = VoxelFormat::kF32;
        request.targets[0].blend = Blend::kMax;
        request.targets[0].shader = {"triangle_id", {}};
      }
      if (i == 8) {  // in accumulators of sums
        request.targets[0].components = 4;
        request.targets[0].blend = Blend::kAverage;
        request.targets[0].shader = {"normal", {}};
      }
      requests.push_back(request);
    }
    for (size_t i = 0; i < meshes.size(); ++i) expected.push_back(Arrays(*Devices().back(), i).value());
  }

  absl::StatusOr<std::vector<std::vector<uint8_t>>> Arrays(const Backend& device, size_t i) const {
    const absl::StatusOr<VoxelizeResult> result =
        Voxelize(meshes[i], requests[i], {.job = JobContext(), .backend = &device});
    if (!result.ok()) return result.status();
    std::vector<std::vector<uint8_t>> arrays;
    for (const auto& bytes : ArraysOf(*result)) arrays.emplace_back(bytes.begin(), bytes.end());
    return arrays;
  }
};

// Runs of `threads` threads, all at the same time; how many gave other bytes or an error.
int RunAtOnce(const Backend& device, const Jobs& jobs, int threads, int rounds) {
  std::vector<int> bad(static_cast<size_t>(threads));
  std::vector<std::thread> running;
  for (int t = 0; t < threads; ++t) {
    running.emplace_back([&, t] {
      for (int round = 0; round < rounds; ++round) {
        for (size_t i = 0; i < jobs.meshes.size(); ++i) {
          const size_t job = (i + static_cast<size_t>(t) * 5) % jobs.meshes.size();
          const auto got = jobs.Arrays(device, job);
          bad[static_cast<size_t>(t)] += !got.ok() || *got != jobs.expected[job];
        }
      }
    });
  }
  int all = 0;
  for (std::thread& thread : running) thread.join();
  for (const int count : bad) all += count;
  return all;
}

__global__ void WriteNowhere(int* to) {
  *to = 1;
}

// An illegal write: the driver answers every further call with the same error until the device is reset.
void Break(int ordinal) {
  (void)cudaSetDevice(ordinal);
  WriteNowhere<<<1, 1>>>(reinterpret_cast<int*>(16));
  (void)cudaDeviceSynchronize();
  (void)cudaGetLastError();
}

int Main(const char* self, bool probe_alone) {
  std::vector<const Backend*> devices;
  for (const Backend* device : Devices()) {
    if (device->name() == "cuda") devices.push_back(device);
  }
  if (devices.empty()) {
    std::printf("SKIPPED: no CUDA device\n");
    return 77;
  }
  if (probe_alone) {
    return std::all_of(devices.begin(), devices.end(), [](const Backend* device) { return device->Probe().ok(); }) ? 0
                                                                                                                   : 1;
  }
  const Jobs jobs;
  for (const Backend* device : devices) {
    const std::string name =
        device->device() + " (" + device->model() + ", " + std::to_string(device->memory_bytes() >> 20) + " MiB)";
    Expect(device->Probe().ok(), name + " passes the probe");
    for (const int threads : {1, 4}) {
      const int bad = RunAtOnce(*device, jobs, threads, 10);
      Expect(bad == 0, name + ": " + std::to_string(threads) + " threads, " +
                           std::to_string(threads * 10 * int(jobs.meshes.size())) + " runs, " + std::to_string(bad) +
                           " with other bytes than the CPU's");
    }
  }
  if (devices.size() > 1) {
    std::vector<int> bad(devices.size());
    std::vector<std::thread> running;
    for (size_t d = 0; d < devices.size(); ++d) {
      running.emplace_back([&, d] { bad[d] = RunAtOnce(*devices[d], jobs, 2, 5); });
    }
    for (std::thread& thread : running) thread.join();
    Expect(std::all_of(bad.begin(), bad.end(), [](int b) { return b == 0; }),
           std::to_string(devices.size()) + " devices at once");
  }
  for (size_t d = 0; d < devices.size(); ++d) {
    const Backend& device = *devices[d];
    for (int round = 0; round < 2; ++round) {
      Break(std::atoi(device.device().substr(5).c_str()));
      const absl::Status first = jobs.Arrays(device, 0).status(), second = jobs.Arrays(device, 0).status();
      std::printf("      %s\n      %s\n", first.ToString().c_str(), second.ToString().c_str());
      Expect(DeviceFailureOf(first) == DeviceFailureKind::kLost, device.device() + " broken: the run says so");
      Expect(second.code() == absl::StatusCode::kFailedPrecondition, device.device() + " is not used any more");
      for (size_t other = 0; other < devices.size(); ++other) {
        if (other == d) continue;
        // Some drivers take all devices of a process for one that failed: then the others are lost too, and say so.
        const absl::Status status = jobs.Arrays(*devices[other], 0).status();
        const bool lost = DeviceFailureOf(status) == DeviceFailureKind::kLost;
        Expect(lost || RunAtOnce(*devices[other], jobs, 1, 1) == 0,
               devices[other]->device() + (lost ? " is lost with it" : " goes on"));
      }
      const absl::Status probed = device.Probe();
      if (probed.ok()) {
        Expect(RunAtOnce(device, jobs, 4, 2) == 0, device.device() + " is reset and works as before");
      } else {  // the driver does not give it back
        std::printf("      %s\n", probed.ToString().c_str());
        Expect(DeviceFailureOf(probed) == DeviceFailureKind::kLost, device.device() + " stays lost to this process");
        Expect(DeviceFailureOf(jobs.Arrays(device, 0).status()) == DeviceFailureKind::kLost,
               device.device() + " is not used for it");
        break;
      }
    }
  }
  Expect(std::system((std::string(self) + " --probe").c_str()) == 0, "another process finds every device working");
  std::printf("cuda_devices: %zu devices, %d wrong\n", devices.size(), wrong);
  return wrong == 0 ? 0 : 1;
}

}  // namespace
}  // namespace voxelpipe::gpu

int main(int argc, char** argv) {
  return voxelpipe::gpu::Main(argv[0], argc > 1 && std::strcmp(argv[1], "--probe") == 0);
}
