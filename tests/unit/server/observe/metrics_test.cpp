#include "observe/metrics.h"

#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(MetricsTest, ACallIsCountedByMethodAndCodeAndTimedInSeconds) {
  Metrics metrics;
  metrics.CallBegan(Rpc::kVoxelize);
  EXPECT_THAT(metrics.Text(), HasSubstr("voxelpipe_calls_in_flight{method=\"Voxelize\"} 1\n"));
  metrics.CallEnded(Rpc::kVoxelize, absl::StatusCode::kResourceExhausted, .25);
  const std::string text = metrics.Text();
  EXPECT_THAT(text, HasSubstr("voxelpipe_calls_in_flight{method=\"Voxelize\"} 0\n"));
  EXPECT_THAT(text, HasSubstr("voxelpipe_calls_total{code=\"RESOURCE_EXHAUSTED\",method=\"Voxelize\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("voxelpipe_calls_total{code=\"OK\",method=\"Voxelize\"} 0\n"));
  EXPECT_THAT(text, HasSubstr("voxelpipe_call_seconds_sum{method=\"Voxelize\"} 0.25\n"));
  EXPECT_THAT(text, HasSubstr("voxelpipe_call_seconds_count{method=\"Voxelize\"} 1\n"));
}

TEST(MetricsTest, ACodeThatIsNotOneOfTheSeventeenCountsAsUnknown) {
  Metrics metrics;
  metrics.JobEnded(absl::StatusCode(77));
  EXPECT_THAT(metrics.Text(), HasSubstr("voxelpipe_jobs_total{code=\"UNKNOWN\"} 1\n"));
}

TEST(MetricsTest, AStageThatIsNotKnownGoesToOther) {
  Metrics metrics;
  metrics.Stage("fine_raster").Observe(.5);
  metrics.Stage("from a stranger").Observe(2);
  const std::string text = metrics.Text();
  EXPECT_THAT(text, HasSubstr("voxelpipe_stage_seconds_sum{stage=\"fine_raster\"} 0.5\n"));
  EXPECT_THAT(text, HasSubstr("voxelpipe_stage_seconds_sum{stage=\"other\"} 2\n"));
  EXPECT_THAT(text, Not(HasSubstr("stranger")));
}

TEST(MetricsTest, ADeviceIsOneHoweverOftenItIsAskedFor) {
  Metrics metrics;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) threads.emplace_back([&] { metrics.Device("cuda:0").failures.Increment(); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(metrics.Text(), HasSubstr("voxelpipe_device_failures_total{device=\"cuda:0\"} 4\n"));
}

TEST(MetricsTest, ASamplerSetsItsGaugesBeforeEachTextUntilItGoes) {
  Metrics metrics;
  int length = 3;
  auto sampler = metrics.BeforeText([&] { metrics.QueueJobs(0).Set(length); });
  EXPECT_THAT(metrics.Text(), HasSubstr("voxelpipe_queue_jobs{priority=\"high\"} 3\n"));
  length = 4;
  EXPECT_THAT(metrics.Text(), HasSubstr("voxelpipe_queue_jobs{priority=\"high\"} 4\n"));
  sampler.reset();
  length = 5;
  EXPECT_THAT(metrics.Text(), HasSubstr("voxelpipe_queue_jobs{priority=\"high\"} 4\n"));
}

TEST(MetricsTest, TheProcessIsThere) {
  Metrics metrics;
  const std::string text = metrics.Text();
  for (const char* name : {"process_cpu_seconds_total", "process_resident_memory_bytes", "process_open_fds",
                           "process_threads", "process_start_time_seconds"}) {
    EXPECT_THAT(text, HasSubstr(std::string("\n") + name + " ")) << name;
  }
}

}  // namespace
}  // namespace voxelpipe
