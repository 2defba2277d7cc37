#include "schedule/device_choice.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

const WorkerTraits kCpuWorker{"cpu", BackendChoice::kCpu};
const WorkerTraits kGpu0Worker{"cuda:0", BackendChoice::kCuda};
const WorkerTraits kGpu1Worker{"cuda:1", BackendChoice::kCuda};
const std::vector<ServingDevice> kAllDevices{{kGpu0Worker, 2}, {kGpu1Worker, 2}, {kCpuWorker, 2}};
const std::vector<ServingDevice> kOnlyCpu{{kCpuWorker, 2}};

TaskTraits Wants(BackendChoice backend, bool fallback) {
  TaskTraits traits;
  traits.backend = backend;
  traits.fallback = fallback;
  return traits;
}

TEST(DeviceChoiceTest, AutoMayRunAnywhere) {
  for (const WorkerTraits& worker : {kCpuWorker, kGpu0Worker, kGpu1Worker}) {
    EXPECT_TRUE(MayHave(Wants(BackendChoice::kAuto, true), worker, kAllDevices));
  }
}

TEST(DeviceChoiceTest, ANamedKindStaysThereWhileItServes) {
  const TaskTraits task = Wants(BackendChoice::kCuda, true);
  EXPECT_TRUE(MayHave(task, kGpu0Worker, kAllDevices));
  EXPECT_FALSE(MayHave(task, kCpuWorker, kAllDevices)) << "fallback is for failures, not for haste";
  EXPECT_TRUE(MayHave(task, kCpuWorker, kOnlyCpu));
}

TEST(DeviceChoiceTest, WithoutFallbackAnotherKindNeverHasIt) {
  const TaskTraits task = Wants(BackendChoice::kCuda, false);
  EXPECT_FALSE(MayHave(task, kCpuWorker, kAllDevices));
  EXPECT_FALSE(MayHave(task, kCpuWorker, kOnlyCpu));
  EXPECT_TRUE(AnyMayHave(task, kAllDevices));
  EXPECT_FALSE(AnyMayHave(task, kOnlyCpu));
}

TEST(DeviceChoiceTest, ADeviceThatFailedItDoesNotGetItAgain) {
  TaskTraits task = Wants(BackendChoice::kCuda, true);
  task.excluded_devices = {"cuda:0"};
  EXPECT_FALSE(MayHave(task, kGpu0Worker, kAllDevices));
  EXPECT_TRUE(MayHave(task, kGpu1Worker, kAllDevices));
  EXPECT_FALSE(MayHave(task, kCpuWorker, kAllDevices)) << "a second GPU is left";
  task.excluded_devices = {"cuda:0", "cuda:1"};
  EXPECT_TRUE(MayHave(task, kCpuWorker, kAllDevices));
}

TEST(DeviceChoiceTest, AFallbackIsAnotherKindThanTheOneThatWasMeant) {
  EXPECT_FALSE(IsFallback(Wants(BackendChoice::kCuda, true), kGpu1Worker));
  EXPECT_TRUE(IsFallback(Wants(BackendChoice::kCuda, true), kCpuWorker));
  EXPECT_TRUE(IsFallback(Wants(BackendChoice::kCpu, true), kGpu0Worker));
  TaskTraits open = Wants(BackendChoice::kAuto, true);
  EXPECT_FALSE(IsFallback(open, kCpuWorker)) << "it was never meant for a GPU alone";
  open.excluded_devices = {"cuda:0"};
  EXPECT_FALSE(IsFallback(open, kGpu1Worker)) << "another of the same kind";
  EXPECT_TRUE(IsFallback(open, kCpuWorker));
}

TEST(DeviceChoiceTest, NothingServesNothing) {
  EXPECT_FALSE(AnyMayHave(Wants(BackendChoice::kAuto, true), {}));
}

// Workers of one kind, of which some are idle, that take so long for the task alone.
KindOutlook Workers(size_t workers, size_t idle, double task_ms, double free_in_ms = 0, double waiting_ms = 0) {
  return {workers, idle, free_in_ms, task_ms, std::max(task_ms, waiting_ms)};
}

TEST(LeavesToOtherKindTest, OfIdleDevicesTheFasterTakesATask) {
  for (const auto& [cpu_ms, gpu_ms] : {std::pair{1.0, 5.0}, std::pair{5.0, 1.0}, std::pair{3.0, 3.0}}) {
    const KindOutlook cpu = Workers(2, 2, cpu_ms), gpu = Workers(2, 2, gpu_ms);
    EXPECT_EQ(LeavesToOtherKind(BackendChoice::kCpu, cpu, gpu, 1), cpu_ms >= gpu_ms);
    EXPECT_EQ(LeavesToOtherKind(BackendChoice::kCuda, cpu, gpu, 1), cpu_ms < gpu_ms);
  }
}

TEST(LeavesToOtherKindTest, TheCpuTakesWhatItEndsBeforeABusyGpuWould) {
  const KindOutlook gpu = Workers(2, 0, 1, /*free_in_ms=*/10);
  EXPECT_FALSE(LeavesToOtherKind(BackendChoice::kCpu, Workers(1, 1, 10.5), gpu, 1));
  EXPECT_TRUE(LeavesToOtherKind(BackendChoice::kCpu, Workers(1, 1, 11.5), gpu, 1));
}

TEST(LeavesToOtherKindTest, TheCpuHelpsWhereMoreWaitsThanTheGpusSoonDo) {
  const KindOutlook cpu = Workers(1, 1, 20);
  EXPECT_TRUE(LeavesToOtherKind(BackendChoice::kCpu, cpu, Workers(2, 0, 1, 5, /*waiting_ms=*/28), 28));
  EXPECT_FALSE(LeavesToOtherKind(BackendChoice::kCpu, cpu, Workers(2, 0, 1, 5, /*waiting_ms=*/32), 32));
}

TEST(LeavesToOtherKindTest, AGpuLeavesOnlyWhatIdleCpuWorkersTakeAtOnce) {
  const KindOutlook gpu = Workers(1, 1, 5);
  EXPECT_TRUE(LeavesToOtherKind(BackendChoice::kCuda, Workers(2, 2, 1), gpu, 2));
  EXPECT_FALSE(LeavesToOtherKind(BackendChoice::kCuda, Workers(2, 2, 1), gpu, 3)) << "one would wait";
  EXPECT_FALSE(LeavesToOtherKind(BackendChoice::kCuda, Workers(2, 0, 1, 0.5), gpu, 1)) << "nobody is idle";
}

TEST(LeavesToOtherKindTest, NothingIsLeftToAKindThatDoesNotServe) {
  EXPECT_FALSE(LeavesToOtherKind(BackendChoice::kCpu, Workers(1, 1, 100), Workers(0, 0, 1), 1));
  EXPECT_FALSE(LeavesToOtherKind(BackendChoice::kCuda, Workers(0, 0, 1), Workers(1, 1, 100), 1));
}

}  // namespace
}  // namespace voxelpipe
