#include "schedule/admission.h"

#include "gtest/gtest.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
const JobContext::Clock::time_point kNow{};

Backlog Waiting(size_t jobs, double ms) {
  Backlog backlog;
  backlog.jobs = jobs;
  backlog.ms = ms;
  backlog.ahead_ms = ms;
  backlog.bytes = jobs * 1000;
  backlog.running = 2;
  backlog.workers = 2;
  return backlog;
}

AdmissionAnswer Ask(const Backlog& backlog, const TaskTraits& traits = {}, double ms = 1) {
  return AdmitTask({100, 50'000, 1000}, backlog, traits, ms, kNow);
}

TEST(AdmissionTest, EachLimitRefusesWithATimeToComeAgain) {
  EXPECT_EQ(Ask(Waiting(10, 100)).why, Refused::kNo);
  EXPECT_EQ(Ask(Waiting(100, 100)).why, Refused::kJobs);
  EXPECT_EQ(Ask(Waiting(51, 100)).why, Refused::kBytes);
  EXPECT_EQ(Ask(Waiting(10, 999.5)).why, Refused::kTime);
  for (const Backlog& backlog : {Waiting(100, 100), Waiting(51, 100), Waiting(10, 999.5)}) {
    const absl::Status status = Ask(backlog).status;
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
    EXPECT_TRUE(RetryDelay(status).has_value()) << status;
  }
}

TEST(AdmissionTest, TheTimeToComeAgainGrowsWithTheBacklogAndHasBounds) {
  const auto delay = [](double ms) { return RetryDelay(Ask(Waiting(100, ms)).status)->count(); };
  EXPECT_EQ(delay(10), 50);
  EXPECT_LT(delay(5'000), delay(50'000));
  EXPECT_EQ(delay(1e9), 30'000);
}

TEST(AdmissionTest, WhatAnIdleWorkerTakesAtOnceDoesNotWait) {
  Backlog backlog = Waiting(0, 0);
  backlog.running = 1;
  EXPECT_EQ(AdmitTask({0, 0, 0}, backlog, {}, 1e9, kNow).why, Refused::kNo);
  backlog.running = 2;
  EXPECT_EQ(AdmitTask({0, 0, 0}, backlog, {}, 1, kNow).why, Refused::kJobs);
}

TEST(AdmissionTest, AnyTaskMayWaitAlone) {
  TaskTraits traits;
  traits.cost.held_bytes = 1u << 30;
  EXPECT_EQ(Ask(Waiting(0, 0), traits, 1e7).why, Refused::kNo);
}

TEST(AdmissionTest, OneClientLeavesPlacesForOthers) {
  Backlog backlog = Waiting(40, 100);
  backlog.bytes = 0;
  backlog.jobs = backlog.client_jobs = 88;
  EXPECT_EQ(Ask(backlog).why, Refused::kNo);
  backlog.jobs = backlog.client_jobs = 89;
  EXPECT_EQ(Ask(backlog).why, Refused::kJobs);
  backlog.client_jobs = 0;
  EXPECT_EQ(Ask(backlog).why, Refused::kNo) << "another client finds a place";
}

TEST(AdmissionTest, AWaitThatIsTwiceTheDeadlineIsTheBacklogsFault) {
  TaskTraits traits;
  traits.deadline = kNow + milliseconds(100);
  EXPECT_EQ(Ask(Waiting(10, 399), traits).why, Refused::kNo) << "two workers share it";
  const AdmissionAnswer answer = Ask(Waiting(10, 401), traits);
  EXPECT_EQ(answer.why, Refused::kDeadline);
  EXPECT_EQ(answer.status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(RetryDelay(answer.status).has_value());
}

TEST(AdmissionTest, AQueueTimeOutIsADeadlineOfTheWaitOnly) {
  TaskTraits traits;
  traits.queue_timeout = milliseconds(100);
  EXPECT_EQ(Ask(Waiting(10, 401), traits).why, Refused::kDeadline);
  EXPECT_EQ(Ask(Waiting(10, 399), traits, 500).why, Refused::kNo);
}

TEST(AdmissionTest, AJobThatAloneTakesTwiceItsDeadlineIsItsOwnFault) {
  TaskTraits traits;
  traits.deadline = kNow + milliseconds(100);
  EXPECT_EQ(Ask(Waiting(0, 0), traits, 199).why, Refused::kNo);
  const AdmissionAnswer answer = Ask(Waiting(0, 0), traits, 201);
  EXPECT_EQ(answer.why, Refused::kDeadline);
  EXPECT_EQ(answer.status.code(), absl::StatusCode::kDeadlineExceeded);
}

}  // namespace
}  // namespace voxelpipe
