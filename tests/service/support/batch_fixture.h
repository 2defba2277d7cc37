// A stream of VoxelizeBatch to a server of its own, message by message.
#pragma once

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "base/checksum/crc32c.h"
#include "gtest/gtest.h"
#include "service/support/messages.h"
#include "service/support/requests.h"
#include "service/support/sample_mesh.h"
#include "service/support/server_process.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe::testing {

class BatchTest : public ::testing::Test {
 protected:
  using Stream = grpc::ClientReaderWriter<v1::VoxelizeBatchRequest, v1::VoxelizeBatchResponse>;

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
    stream_ = stub_->VoxelizeBatch(&context_);
  }

  v1::BatchJob Job(uint64_t id, const VoxelizeRequest& request) const {
    v1::BatchJob job = JobOf(id, RequestOf(request, glb_));
    job.mutable_request()->mutable_mesh()->mutable_bytes()->set_crc32c(Crc32c(glb_));
    return job;
  }
  // One with another mesh, whose work takes a minute or more.
  v1::BatchJob SlowJob(uint64_t id) const { return JobOf(id, RequestOf(SlowRequest(), endless_)); }

  // Sends jobs as one message. False if the stream is over.
  bool Send(const std::vector<v1::BatchJob>& jobs) {
    v1::VoxelizeBatchRequest message;
    for (const v1::BatchJob& job : jobs) *message.add_jobs() = job;
    return stream_->Write(message);
  }
  bool Send(const v1::BatchJob& job) { return Send(std::vector<v1::BatchJob>{job}); }
  bool Cancel(const std::vector<uint64_t>& ids) {
    v1::VoxelizeBatchRequest message;
    message.mutable_cancel()->Add(ids.begin(), ids.end());
    return stream_->Write(message);
  }

  // The next message. False at the end.
  bool Receive() {
    v1::VoxelizeBatchResponse response;
    if (!stream_->Read(&response)) return false;
    ++messages_;
    Add(response, answers_);
    return true;
  }
  // Jobs with their last reply.
  size_t Ended() const {
    return size_t(std::count_if(answers_.begin(), answers_.end(), [](const auto& job) { return job.second.over; }));
  }
  // All that are left.
  grpc::Status Finish() {
    while (Receive()) {}
    return stream_->Finish();
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

  const std::vector<uint8_t> glb_ = TorusGlb(8), endless_ = LargeTrianglesGlb(20000);
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Client> client_;
  std::unique_ptr<v1::VoxelizationService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<Stream> stream_;
  std::map<uint64_t, Received> answers_;
  size_t messages_ = 0;
};

}  // namespace voxelpipe::testing
