// What `voxelpipe bench` counts and prints.
#include "bench/bench_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "absl/strings/str_join.h"

namespace voxelpipe::cli {
namespace {

using ::testing::HasSubstr;

Outcome Answer(uint64_t latency_ms) {
  Outcome outcome;
  outcome.latency_ns = latency_ms * 1'000'000;
  outcome.result_bytes = 1000;
  outcome.received_bytes = 1100;
  outcome.queue_ns = 1'000'000;
  outcome.voxelize_ns = 2'000'000;
  outcome.worker = "cuda:0/1";
  outcome.batch_jobs = 4;
  outcome.batch_launches = 12;
  outcome.attempts = 1;
  return outcome;
}

Outcome Failure(absl::StatusCode code, uint64_t latency_ms) {
  Outcome outcome;
  outcome.code = code;
  outcome.latency_ns = latency_ms * 1'000'000;
  return outcome;
}

LoadResult ThreeAnswersOfFive() {
  LoadResult result;
  Tally other;
  result.tally.Add(Answer(10));
  result.tally.Add(Answer(20));
  result.tally.Add(Failure(absl::StatusCode::kResourceExhausted, 1));
  other.Add(Failure(absl::StatusCode::kUnavailable, 9000));
  other.Add(Answer(30));
  result.tally.Merge(other);
  result.issue_seconds = 1.5;
  result.drain_seconds = 0.5;
  result.client_cpu_seconds = 0.001;
  result.connections = 1;
  result.call = "mesh";
  return result;
}

TEST(BenchJson, CountsAllAndMeasuresAnswersOnly) {
  const nlohmann::ordered_json json = BenchJson(LoadPlan{}, ThreeAnswersOfFive());
  EXPECT_EQ(json["requests"], 5);
  EXPECT_EQ(json["ok"], 3);
  EXPECT_EQ(json["errors"], (nlohmann::ordered_json{{"RESOURCE_EXHAUSTED", 1}, {"UNAVAILABLE", 1}}));
  EXPECT_EQ(json["seconds"], 2.0);  // sending and draining
  EXPECT_EQ(json["per_second"], 1.5);
  EXPECT_EQ(json["bytes_per_second"], 1500.0);
  EXPECT_EQ(json["received_bytes_per_second"], 1650.0);
  EXPECT_NEAR(json["latency_ms"]["p50"].get<double>(), 20, 20.0 / 256);
  EXPECT_EQ(json["latency_ms"]["max"], 30.0);  // the refused and the lost do not count
  EXPECT_NEAR(json["latency_ms"]["mean"].get<double>(), 20, 1e-9);
  EXPECT_NEAR(json["client"]["cpu_us_per_request"].get<double>(), 200, 1e-9);
}

TEST(BenchJson, MeasuresFailuresByCode) {
  LoadResult result = ThreeAnswersOfFive();
  Outcome told = Failure(absl::StatusCode::kResourceExhausted, 3);
  told.retry_info = true;
  Tally other;
  other.Add(told);
  result.tally.Merge(other);
  const nlohmann::ordered_json json = BenchJson(LoadPlan{}, result);
  EXPECT_EQ(json["errors"]["RESOURCE_EXHAUSTED"], 2);
  EXPECT_EQ(json["errors_with_retry_info"]["RESOURCE_EXHAUSTED"], 1);
  EXPECT_EQ(json["errors_with_retry_info"]["UNAVAILABLE"], 0);
  EXPECT_EQ(json["error_latency_ms"]["RESOURCE_EXHAUSTED"]["max"], 3.0);
  EXPECT_NEAR(json["error_latency_ms"]["RESOURCE_EXHAUSTED"]["p50"].get<double>(), 1, 1.0 / 256);
  EXPECT_EQ(json["error_latency_ms"]["UNAVAILABLE"]["max"], 9000.0);
}

TEST(BenchJson, TellsTheServersShare) {
  const nlohmann::ordered_json server = BenchJson(LoadPlan{}, ThreeAnswersOfFive())["server"];
  EXPECT_EQ(server["queue_ms"]["max"], 1.0);
  EXPECT_EQ(server["voxelize_ms"]["max"], 2.0);
  EXPECT_NEAR(server["other_ms"].get<double>(), 17, 1e-9);
  EXPECT_EQ(server["workers"], (nlohmann::ordered_json{{"cuda:0/1", 3}}));
  EXPECT_EQ(server["batch_jobs"]["mean"], 4.0);
  EXPECT_EQ(server["launches_per_request"], 3.0);  // twelve for four
}

TEST(BenchJson, WithoutAnswersNothingIsDividedByZero) {
  LoadResult result;
  result.tally.Add(Failure(absl::StatusCode::kUnavailable, 1));
  const nlohmann::ordered_json json = BenchJson(LoadPlan{}, result);
  EXPECT_EQ(json["per_second"], 0.0);
  EXPECT_EQ(json["latency_ms"]["p99"], 0.0);
  EXPECT_TRUE(json["server"]["launches_per_request"].is_null());
}

TEST(BenchJson, SaysWhichLoadItWas) {
  LoadPlan plan;
  plan.concurrency = 16;
  EXPECT_EQ(BenchJson(plan, LoadResult())["concurrency"], 16);
  plan.rate = 250;
  const nlohmann::ordered_json open = BenchJson(plan, LoadResult());
  EXPECT_EQ(open["loop"], "open");
  EXPECT_EQ(open["rate"], 250.0);
  EXPECT_FALSE(open.contains("concurrency"));
}

TEST(BenchTable, NamesErrorsAndWorkers) {
  const std::string table = absl::StrJoin(BenchTable(LoadPlan{}, ThreeAnswersOfFive()), "\n");
  EXPECT_THAT(table, HasSubstr("3 of 5 requests"));
  EXPECT_THAT(table, HasSubstr("1 UNAVAILABLE"));
  EXPECT_THAT(table, HasSubstr("max 9000.000"));
  EXPECT_THAT(table, HasSubstr("cuda:0/1 3"));
}

}  // namespace
}  // namespace voxelpipe::cli
