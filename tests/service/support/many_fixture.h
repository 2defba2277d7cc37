// A stream of VoxelizeMany to a server of its own, message by message.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "base/checksum/crc32c.h"
#include "gtest/gtest.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/request.h"

namespace voxelpipe::testing {

class ManyTest : public ::testing::Test {
 protected:
  using Stream = grpc::ClientReaderWriter<v1::VoxelizeManyRequest, v1::VoxelizeManyResponse>;

  void Start(std::vector<std::string> arguments = {}) {
    arguments.insert(arguments.end(), {"--log-level", "warn"});
    server_ = StartServer(arguments);
    ASSERT_NE(server_, nullptr);
    client_ = ConnectTo(*server_);
    ASSERT_NE(client_, nullptr);
    grpc::ChannelArguments unbounded;
    unbounded.SetMaxReceiveMessageSize(-1);
    stub_ = v1::VoxelizationService::NewStub(
        grpc::CreateCustomChannel(server_->address(), grpc::InsecureChannelCredentials(), unbounded));
    context_.set_deadline(std::chrono::system_clock::now() + kPatience);
    stream_ = stub_->VoxelizeMany(&context_);
  }

  v1::VoxelizeManyRequest Item(uint64_t id, const VoxelizeRequest& request) const {
    v1::VoxelizeManyRequest item;
    item.set_id(id);
    *item.mutable_config() = MakeConfig(request, MeshFormat::kGlb);
    item.set_mesh(glb_.data(), glb_.size());
    item.set_crc32c(Crc32c(glb_));
    return item;
  }

  // The bytes of all arrays, as in a single call.
  std::string Single(const VoxelizeRequest& request) {
    const JobContext job;
    const auto result = client_->Voxelize(glb_, MeshFormat::kGlb, request, job);
    EXPECT_TRUE(result.ok()) << result.status();
    std::string all;
    if (!result.ok()) return all;
    for (const auto bytes : ArraysOf(result->result)) all.append(bytes.begin(), bytes.end());
    return all;
  }

  // Waits until the worker is idle and the queue empty: a call succeeds.
  void ExpectFree() {
    JobContext job;
    job.set_deadline(JobContext::Clock::now() + kPatience);
    const absl::Status status = client_->Voxelize(glb_, MeshFormat::kGlb, SmallRequest(), job).status();
    EXPECT_TRUE(status.ok()) << status;
  }

  const std::vector<uint8_t> glb_ = TorusGlb(8);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<Stream> stream_;
};

// The messages for one job.
struct JobAnswer {
  std::string bytes;
  int whole = 0, parts = 0, summaries = 0;
  int error = 0;
};

inline void Add(const v1::VoxelizeManyResponse& response, JobAnswer& answer) {
  if (response.has_whole()) {
    ++answer.whole;
    for (const auto& piece : response.whole().pieces()) answer.bytes += piece.data();
    if (response.whole().has_summary()) ++answer.summaries;
  } else if (response.has_part()) {
    ++answer.parts;
    answer.bytes += response.part().piece().data();
    if (response.part().has_summary()) ++answer.summaries;
  } else {
    answer.error = response.error().code();
  }
}

}  // namespace voxelpipe::testing
