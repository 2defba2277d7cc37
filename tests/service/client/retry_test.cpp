// When a client repeats a call, and what it waits for.
#include "retry.h"

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client.h"
#include "gtest/gtest.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe::testing {
namespace {

using std::chrono::milliseconds;

TEST(RetryTest, WaitsAsLongAsTheServerReturned) {
  const JobContext job;
  EXPECT_EQ(DelayBeforeRetry(BusyError("full", milliseconds(1234)), 0, job), milliseconds(1234));
  EXPECT_EQ(DelayBeforeRetry(NotServingError("draining", milliseconds(77)), 5, job), milliseconds(77));
}

TEST(RetryTest, WithoutADelayOnlyAnUnavailableServerIsTriedAgain) {
  const JobContext job;
  EXPECT_FALSE(DelayBeforeRetry(absl::ResourceExhaustedError("too large"), 0, job));
  EXPECT_FALSE(DelayBeforeRetry(absl::InvalidArgumentError("no"), 0, job));
  EXPECT_FALSE(DelayBeforeRetry(absl::DeadlineExceededError("late"), 0, job));
  for (int repeated = 0; repeated < 40; ++repeated) {
    const auto delay = DelayBeforeRetry(absl::UnavailableError("lost"), repeated, job);
    ASSERT_TRUE(delay);
    EXPECT_GE(*delay, milliseconds(0));
    EXPECT_LE(*delay, milliseconds(std::min(5000, 100 << std::min(repeated, 10)))) << repeated;
  }
}

TEST(RetryTest, NeverBeyondTheDeadlineAndNeverAfterACancellation) {
  JobContext job;
  job.set_deadline(JobContext::Clock::now() + std::chrono::seconds(30));
  EXPECT_TRUE(DelayBeforeRetry(BusyError("full", milliseconds(10)), 0, job));
  EXPECT_FALSE(DelayBeforeRetry(BusyError("full", milliseconds(60'000)), 0, job));
  job.Cancel();
  EXPECT_FALSE(DelayBeforeRetry(BusyError("full", milliseconds(10)), 0, job));
}

TEST(RetryTest, AWaitEndsWithItsJob) {
  JobContext job;
  std::thread canceller([&] { job.Cancel(); });
  EXPECT_TRUE(absl::IsCancelled(WaitUnlessEnded(std::chrono::hours(1), job)));
  canceller.join();
}

// Refuses the first estimates.
class BusyService final : public v1::VoxelizationService::Service {
 public:
  BusyService(int refusals, absl::Status error, int port = 0) : refusals_(refusals), error_(std::move(error)) {
    builder_.AddListeningPort(absl::StrCat("127.0.0.1:", port), grpc::InsecureServerCredentials(), &port_);
    builder_.RegisterService(this);
    server_ = builder_.BuildAndStart();
  }
  grpc::Status EstimateVoxelization(grpc::ServerContext*, const v1::EstimateVoxelizationRequest*,
                                    v1::EstimateVoxelizationResponse* response) override {
    if (calls_++ < refusals_) return ToGrpcStatus(error_);
    Plan plan;
    plan.grid.dims = {3, 4, 5};
    WriteTo(plan, *response->mutable_plan());
    return grpc::Status::OK;
  }
  std::string target() const { return absl::StrCat("127.0.0.1:", port_); }
  int port() const { return port_; }
  int calls() const { return calls_; }

 private:
  int refusals_;
  absl::Status error_;
  std::atomic<int> calls_ = 0;
  int port_ = 0;
  grpc::ServerBuilder builder_;
  std::unique_ptr<grpc::Server> server_;
};

absl::StatusOr<Plan> EstimateBy(Client& client, const JobContext& job) {
  return client.Estimate(12, 8, Box3d{{0, 0, 0}, {1, 1, 1}, false}, VoxelizeRequest{}, job);
}

absl::StatusOr<Plan> EstimateAt(const BusyService& service, int retries, const JobContext& job) {
  ConnectOptions options;
  options.retries = retries;
  const auto client = Client::Connect(service.target(), options);
  if (!client.ok()) return client.status();
  return EstimateBy(**client, job);
}

TEST(RetryTest, AClientRepeatsWhatABusyServerRefused) {
  const JobContext job;
  const BusyService service(2, BusyError("the queue is full", milliseconds(5)));
  const absl::StatusOr<Plan> plan = EstimateAt(service, 2, job);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->grid.dims[2], 5);
  EXPECT_EQ(service.calls(), 3);
}

TEST(RetryTest, AClientReturnsTheLastErrorAfterItsRetries) {
  const JobContext job;
  const BusyService service(1000, BusyError("the queue is full", milliseconds(1)));
  const absl::StatusOr<Plan> plan = EstimateAt(service, 2, job);
  EXPECT_TRUE(absl::IsResourceExhausted(plan.status())) << plan.status();
  EXPECT_EQ(service.calls(), 3);
}

TEST(RetryTest, AClientDoesNotRepeatWhatCannotSucceed) {
  const JobContext job;
  const BusyService service(1000, absl::InvalidArgumentError("targets: none"));
  EXPECT_TRUE(absl::IsInvalidArgument(EstimateAt(service, 2, job).status()));
  EXPECT_EQ(service.calls(), 1);
}

// A gRPC server that shuts down ends new calls with CANCELLED.
TEST(RetryTest, ACallThatTheServerCancelsIsMadeAgain) {
  const JobContext job;
  const BusyService once(1, absl::CancelledError("CANCELLED"));
  EXPECT_TRUE(EstimateAt(once, 2, job).ok());
  EXPECT_EQ(once.calls(), 2);
  const BusyService always(1000, absl::CancelledError("CANCELLED"));
  EXPECT_TRUE(absl::IsUnavailable(EstimateAt(always, 2, job).status()));
}

TEST(RetryTest, TheDelayOfAServerThatDoesNotServeIsKept) {
  const JobContext job;
  const BusyService service(1000, NotServingError("its device failed", milliseconds(77)));
  const absl::Status status = EstimateAt(service, 0, job).status();
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_EQ(RetryDelay(status), milliseconds(77));
}

TEST(RetryTest, AJobWithADeadlineWaitsForAServerThatRestarts) {
  auto service = std::make_unique<BusyService>(0, absl::OkStatus());
  const int port = service->port();
  const auto client = Client::Connect(service->target());  // two retries: below a second
  ASSERT_TRUE(client.ok()) << client.status();
  service.reset();
  JobContext job;
  EXPECT_TRUE(absl::IsUnavailable(EstimateBy(**client, job).status())) << "without a deadline it does not wait";
  job.set_deadline(JobContext::Clock::now() + std::chrono::seconds(60));
  std::thread restart([&] {
    std::this_thread::sleep_for(std::chrono::seconds(2));
    service = std::make_unique<BusyService>(0, absl::OkStatus(), port);
  });
  const absl::StatusOr<Plan> plan = EstimateBy(**client, job);
  restart.join();
  EXPECT_TRUE(plan.ok()) << plan.status();
  JobContext late;
  service.reset();
  late.set_deadline(JobContext::Clock::now() + std::chrono::seconds(1));
  EXPECT_FALSE(EstimateBy(**client, late).ok());
}

}  // namespace
}  // namespace voxelpipe::testing
