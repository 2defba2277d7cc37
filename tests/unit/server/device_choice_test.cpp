#include "work/device_choice.h"

#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

const WorkerTraits kCpu{"cpu", BackendChoice::kCpu};
const WorkerTraits kGpu0{"cuda:0", BackendChoice::kCuda};
const WorkerTraits kGpu1{"cuda:1", BackendChoice::kCuda};
const std::vector<ServingDevice> kAll{{kGpu0, 2}, {kGpu1, 2}, {kCpu, 2}};
const std::vector<ServingDevice> kOnlyCpu{{kCpu, 2}};

TaskTraits Wants(BackendChoice backend, bool fallback) {
  TaskTraits traits;
  traits.backend = backend;
  traits.fallback = fallback;
  return traits;
}

TEST(DeviceChoiceTest, AutoMayRunAnywhere) {
  for (const WorkerTraits& worker : {kCpu, kGpu0, kGpu1}) {
    EXPECT_TRUE(MayHave(Wants(BackendChoice::kAuto, true), worker, kAll));
  }
}

TEST(DeviceChoiceTest, ANamedKindStaysThereWhileItServes) {
  const TaskTraits task = Wants(BackendChoice::kCuda, true);
  EXPECT_TRUE(MayHave(task, kGpu0, kAll));
  EXPECT_FALSE(MayHave(task, kCpu, kAll)) << "fallback is for failures, not for haste";
  EXPECT_TRUE(MayHave(task, kCpu, kOnlyCpu));
}

TEST(DeviceChoiceTest, WithoutFallbackAnotherKindNeverHasIt) {
  const TaskTraits task = Wants(BackendChoice::kCuda, false);
  EXPECT_FALSE(MayHave(task, kCpu, kAll));
  EXPECT_FALSE(MayHave(task, kCpu, kOnlyCpu));
  EXPECT_TRUE(AnyMayHave(task, kAll));
  EXPECT_FALSE(AnyMayHave(task, kOnlyCpu));
}

TEST(DeviceChoiceTest, ADeviceThatFailedItDoesNotGetItAgain) {
  TaskTraits task = Wants(BackendChoice::kCuda, true);
  task.excluded_devices = {"cuda:0"};
  EXPECT_FALSE(MayHave(task, kGpu0, kAll));
  EXPECT_TRUE(MayHave(task, kGpu1, kAll));
  EXPECT_FALSE(MayHave(task, kCpu, kAll)) << "a second GPU is left";
  task.excluded_devices = {"cuda:0", "cuda:1"};
  EXPECT_TRUE(MayHave(task, kCpu, kAll));
}

TEST(DeviceChoiceTest, AFallbackIsAnotherKindThanTheOneThatWasMeant) {
  EXPECT_FALSE(IsFallback(Wants(BackendChoice::kCuda, true), kGpu1));
  EXPECT_TRUE(IsFallback(Wants(BackendChoice::kCuda, true), kCpu));
  EXPECT_TRUE(IsFallback(Wants(BackendChoice::kCpu, true), kGpu0));
  TaskTraits open = Wants(BackendChoice::kAuto, true);
  EXPECT_FALSE(IsFallback(open, kCpu)) << "it was never meant for a GPU alone";
  open.excluded_devices = {"cuda:0"};
  EXPECT_FALSE(IsFallback(open, kGpu1)) << "another of the same kind";
  EXPECT_TRUE(IsFallback(open, kCpu));
}

TEST(DeviceChoiceTest, NothingServesNothing) {
  EXPECT_FALSE(AnyMayHave(Wants(BackendChoice::kAuto, true), {}));
}

TEST(DeviceChoiceTest, TheCpuHelpsWhereMoreWaitsThanTheGpusTakeNext) {
  const TaskTraits task = Wants(BackendChoice::kAuto, true);
  const size_t batch = 16, next = 2 * 2 * batch;
  EXPECT_TRUE(LeavesToGpus(task, kCpu, kAll, 1, batch));
  EXPECT_TRUE(LeavesToGpus(task, kCpu, kAll, next, batch));
  EXPECT_FALSE(LeavesToGpus(task, kCpu, kAll, next + 1, batch));
  EXPECT_FALSE(LeavesToGpus(task, kGpu0, kAll, 1, batch));
  EXPECT_FALSE(LeavesToGpus(task, kCpu, kOnlyCpu, 1, batch)) << "no GPU serves";
}

TEST(DeviceChoiceTest, TheCpuDoesNotLeaveWhatTheGpusFailedOrWhatIsItsOwn) {
  TaskTraits failed = Wants(BackendChoice::kAuto, true);
  failed.excluded_devices = {"cuda:0", "cuda:1"};
  EXPECT_FALSE(LeavesToGpus(failed, kCpu, kAll, 1, 16));
  EXPECT_FALSE(LeavesToGpus(Wants(BackendChoice::kCpu, false), kCpu, kAll, 1, 16));
}

}  // namespace
}  // namespace voxelpipe
