// A server with little memory for its jobs, files of a few bytes that ask for much, and clients that do not wait for
// the answer.
#include <algorithm>
#include <chrono>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/process_facts.h"
#include "service/support/requests.h"
#include "service/support/server_process.h"
#include "support/meshes/hostile_meshes.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

constexpr uint64_t kMiB = 1 << 20;

class HostileMeshTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = StartServer({"--log-level", "error", "--max-working-bytes", "256MiB", "--idle-memory-ms", "200"});
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
  }

  // Sends the file, and leaves after `patience`. The server must not have grown by much, and serve the next one.
  absl::Status Send(const std::string& name, const ByteVector& file, std::chrono::milliseconds patience) {
    VoxelizeRequest request = SmallRequest();
    request.targets[0].format = VoxelFormat::kU8;
    request.targets[0].blend = Blend::kReplace;
    request.targets[0].shader.name = "base_color";
    const uint64_t before = ReadProcessFacts(server_->pid()).peak_bytes;
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + patience);
    const auto begin = std::chrono::steady_clock::now();
    const absl::Status status = client_->Voxelize(file, MeshFormat::kAuto, request, job).status();
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    const uint64_t after = ReadProcessFacts(server_->pid()).peak_bytes;
    const uint64_t grown = after - std::min(after, before);  // the system counts pages by the dozen
    std::cout << name << ": " << file.size() << " bytes -> " << grown / kMiB << " MiB, " << seconds << " s, "
              << status.ToString().substr(0, 160) << std::endl;
    if (!IsSanitized(server_->pid())) {
      EXPECT_LT(grown, 600 * kMiB) << name;
    }
    return status;
  }

  // A small job is answered, since no worker is held any more.
  void ExpectServes() {
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + std::chrono::seconds(10 * kSlowdown));
    const auto result = client_->Voxelize(CubeGlb(), MeshFormat::kGlb, SmallRequest(), job);
    EXPECT_TRUE(result.ok()) << result.status();
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

TEST_F(HostileMeshTest, WhatAFewBytesAskForIsRefusedOrFitsIntoTheBudget) {
  const std::chrono::seconds patience(30 * kSlowdown);
  const auto refused = [&](const std::string& name, const ByteVector& file) {
    const absl::Status status = Send(name, file, patience);
    EXPECT_TRUE(absl::IsResourceExhausted(status)) << name << ": " << status;
    EXPECT_FALSE(RetryDelay(status).has_value()) << "it will never fit: " << status;
  };
  refused("instances without data", InstancesWithoutData(10'000'000));
  refused("empty primitives, instanced", EmptyPrimitivesWithoutData(50, 10'000'000));
  refused("textures of 64 Mi texels", LargePngs(8192, 4));
  refused("16 MB of empty nodes", EmptyObjects(16 * kMiB, "nodes"));
  (void)Send("own attributes", ManyOwnAttributes(9000), patience);
  (void)Send("32 MB of extras", EmptyObjects(32 * kMiB, "extras"), patience);
  ExpectServes();
}

TEST_F(HostileMeshTest, AClientThatLeavesLeavesNoWorkBehind) {
  for (int i = 0; i < 3; ++i) {
    (void)Send("textures", LargePngs(4096, 1), std::chrono::milliseconds(300));
    (void)Send("nodes", EmptyObjects(3 * kMiB, "nodes"), std::chrono::milliseconds(300));
  }
  ExpectServes();
}

}  // namespace
}  // namespace voxelpipe::testing
