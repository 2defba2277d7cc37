// What a server does all day, many times over: memory, descriptors and threads come back to where they were.
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "service/support/effort.h"
#include "service/support/process_facts.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"

namespace voxelpipe::testing {
namespace {

// The allocator's and gRPC's own leftovers, which do not grow with what is repeated.
constexpr uint64_t kWanderBytes = 16 << 20;

class MemoryTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = StartServer({"--log-level", "error", "--workers", "1", "--threads", "1", "--idle-memory-ms", "200",
                           "--stream-above-mb", "4096", "--max-mesh-store-bytes", "16MiB"});
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
  }

  // Does `work` some times so that all that is made once is there, then `rounds` times, and looks.
  template <typename Work>
  void ExpectBackAfter(int first, int rounds, const Work& work) {
    for (int i = 0; i < first; ++i) ASSERT_NO_FATAL_FAILURE(work(i));
    const ProcessFacts before = SettledProcessFacts(server_->pid());
    for (int i = 0; i < rounds; ++i) ASSERT_NO_FATAL_FAILURE(work(i));
    const ProcessFacts after = SettledProcessFacts(server_->pid());
    std::cout << "before: " << before.ToString() << "\nafter " << rounds << ": " << after.ToString() << std::endl;
    EXPECT_EQ(after.descriptors, before.descriptors);
    // One thread a round would be a hundred at least; gRPC's pollers and timers come and go by a few.
    EXPECT_LE(after.threads, before.threads + 8);
    if (!IsSanitized(server_->pid())) {
      EXPECT_LE(after.resident_bytes, before.resident_bytes + kWanderBytes);
    }
  }

  void Voxelize(const std::vector<uint8_t>& glb, const VoxelizeRequest& request) {
    const JobContext job;
    const auto result = client_->Voxelize(glb, MeshFormat::kGlb, request, job);
    ASSERT_TRUE(result.ok()) << result.status();
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
};

TEST_F(MemoryTest, SmallJobsLeaveNothing) {
  const std::vector<uint8_t> glb = TorusGlb(8);
  ExpectBackAfter(200, Effort(1'000, 100'000), [&](int) { Voxelize(glb, SmallRequest()); });
}

// Of 4 to 45 MB, no two of a size in a row.
TEST_F(MemoryTest, LargeResultsOfChangingSizeLeaveNothing) {
  const std::vector<uint8_t> glb = TorusGlb(8);
  ExpectBackAfter(10, Effort(20, 1'000), [&](int i) {
    VoxelizeRequest request = SmallRequest();
    const int64_t n = 100 + i * 37 % 125;
    request.grid.fit = GridFit::kCube;
    request.grid.resolution = n;
    request.targets[0].format = VoxelFormat::kF32;
    request.targets[0].blend = Blend::kReplace;
    Voxelize(glb, request);
  });
}

TEST_F(MemoryTest, MeshesThatComeAndGoLeaveNothing) {
  ExpectBackAfter(20, Effort(100, 1'000), [&](int i) {
    const JobContext job;
    const auto mesh = client_->UploadMesh(LargeTrianglesGlb(1'000 + i * 791 % 20'000), MeshFormat::kGlb, job);
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    const absl::StatusOr<uint64_t> gone = client_->ReleaseMesh(mesh->name);
    ASSERT_TRUE(gone.ok()) << gone.status();
  });
}

// Every connection is a new one, as those of short-lived programs are.
TEST_F(MemoryTest, ClientsThatComeAndGoLeaveNothing) {
  const std::vector<uint8_t> glb = TorusGlb(8);
  ExpectBackAfter(50, Effort(100, 3'000), [&](int) {
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    Voxelize(glb, SmallRequest());
  });
}

}  // namespace
}  // namespace voxelpipe::testing
