// Which tasks loaders take, and what keeps them from it.
#include "schedule/scheduler.h"

#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "scheduler_fixture.h"
#include "waiting_task.h"

namespace voxelpipe {
namespace {

using testing::MakeTask;
using testing::SchedulerTest;
using testing::Tasks;
using testing::WaitingTask;

TEST_F(SchedulerTest, GiantFilesLeaveALoaderToTheOthers) {
  options.loaders = 2;
  Start(1);
  std::vector<std::shared_ptr<WaitingTask>> giants;
  const auto unloaded = [](double load_ms) {
    auto task = MakeTask();
    task->is_loaded = false;
    task->traits.cost.load_ms = load_ms;
    return task;
  };
  for (int i = 0; i < 2; ++i) giants.push_back(Submit(unloaded(5000)));
  const auto small = Submit(unloaded(1));
  EXPECT_EQ(scheduler->TakeLoad(), giants[0]);
  EXPECT_EQ(scheduler->TakeLoad(), small);
  scheduler->Ended(*giants[0]);
  EXPECT_EQ(scheduler->TakeLoad(), giants[1]);
  scheduler->Ended(*small);
  scheduler->Ended(*giants[1]);
}

// A task of a client that must be loaded first.
auto Unloaded(const std::string& client, uint64_t held_bytes = 0) {
  auto task = MakeTask(client);
  task->is_loaded = false;
  task->traits.cost.held_bytes = held_bytes;
  return task;
}

TEST_F(SchedulerTest, NoMoreAreLoadedAtTheSameTimeThanThereAreLoaders) {
  options.loaders = 2;
  Start();
  std::vector<std::shared_ptr<WaitingTask>> tasks;
  for (int i = 0; i < 4; ++i) tasks.push_back(Submit(Unloaded("a")));
  EXPECT_EQ(scheduler->TryTakeLoad(), tasks[0]);
  EXPECT_EQ(scheduler->TryTakeLoad(), tasks[1]);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr);
  scheduler->SetLoaders(3);
  EXPECT_EQ(scheduler->TryTakeLoad(), tasks[2]);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr);
  scheduler->SetLoaders(2);
  scheduler->Ended(*tasks[0]);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr) << "two are loaded still";
  scheduler->Ended(*tasks[1]);
  EXPECT_EQ(scheduler->TryTakeLoad(), tasks[3]);
  for (const auto i : {2, 3}) scheduler->Ended(*tasks[size_t(i)]);
}

// Estimates that seemed to be free took turns with the smallest files, and nothing limited how many could wait.
TEST_F(SchedulerTest, EstimatesAreChargedWhatTheyTake) {
  options.loaders = 1;
  MeshFacts large, small;
  large.triangles = 10'000'000;
  small.triangles = 1000;
  VoxelizeRequest request;
  request.result = ResultKind::kSparse;
  const auto estimate = [&](const std::string& client, const MeshFacts& mesh) {
    auto task = Unloaded(client);
    task->traits.cost = PredictEstimateCost(request, mesh);
    return task;
  };
  options.max_queue_ms = 4 * PredictEstimateCost(request, large).load_ms;
  Start(1);
  std::vector<std::shared_ptr<WaitingTask>> floods, others;
  for (int i = 0; i < 3; ++i) floods.push_back(Submit(estimate("flood", large)));
  for (int i = 0; i < 5; ++i) others.push_back(Submit(estimate("b", small)));
  absl::Status full = scheduler->Submit(estimate("flood", large));
  EXPECT_TRUE(absl::IsResourceExhausted(full)) << full;
  const auto load_one = [&] {
    const auto task = scheduler->TryTakeLoad();
    if (task) scheduler->Ended(*task);
    return task;
  };
  EXPECT_EQ(load_one(), floods[0]);
  for (const auto& other : others) EXPECT_EQ(load_one(), other);
  EXPECT_EQ(load_one(), floods[1]);
  EXPECT_EQ(load_one(), floods[2]);
}

TEST_F(SchedulerTest, ADecodeDoesNotWaitForThoseOfAnotherClient) {
  options.loaders = 2;
  Start();
  std::vector<std::shared_ptr<WaitingTask>> floods;
  for (int i = 0; i < 4; ++i) floods.push_back(Submit(Unloaded("flood")));
  EXPECT_EQ(scheduler->TryTakeLoad(), floods[0]);
  EXPECT_EQ(scheduler->TryTakeLoad(), floods[1]);
  const auto first = Submit(Unloaded("b")), second = Submit(Unloaded("b")), other = Submit(Unloaded("c"));
  EXPECT_EQ(scheduler->TryTakeLoad(), first);
  EXPECT_EQ(scheduler->TryTakeLoad(), other);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr) << "each has one";
  first->is_loaded = true;
  scheduler->Resubmit(first);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr) << "what was loaded for it waits for a worker";
  EXPECT_EQ(Take(), Tasks{first});
  EXPECT_EQ(scheduler->TryTakeLoad(), second);
  for (const auto& task : {floods[0], floods[1], second, other}) scheduler->Ended(*task);
  for (const auto& task : {floods[2], floods[3]}) {
    EXPECT_EQ(scheduler->TryTakeLoad(), task);
    scheduler->Ended(*task);
  }
}

// Giants of others take all loaders but one; a client's first one is no reason to wait for them.
TEST_F(SchedulerTest, AGiantFileDoesNotWaitForThoseOfAnotherClient) {
  options.loaders = 2;
  Start();
  const auto giant = [](const std::string& client) {
    auto task = Unloaded(client);
    task->traits.cost.load_ms = 5000;
    return task;
  };
  const auto a = Submit(giant("a")), again = Submit(giant("a")), b = Submit(giant("b"));
  EXPECT_EQ(scheduler->TryTakeLoad(), a);
  EXPECT_EQ(scheduler->TryTakeLoad(), b);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr);
  scheduler->Ended(*a);
  scheduler->Ended(*b);
  EXPECT_EQ(scheduler->TryTakeLoad(), again);
  scheduler->Ended(*again);
}

TEST_F(SchedulerTest, NothingIsLoadedWhileTooMuchWaitsForWorkers) {
  options.loaders = 4;
  options.max_ready_bytes = 100;
  Start();
  std::vector<std::shared_ptr<WaitingTask>> tasks;
  for (int i = 0; i < 3; ++i) tasks.push_back(Submit(Unloaded("a", 1)));
  EXPECT_EQ(scheduler->TryTakeLoad(), tasks[0]);
  tasks[0]->is_loaded = true;
  tasks[0]->traits.cost.held_bytes = 100;  // what was made of the file
  scheduler->Resubmit(tasks[0]);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr);
  const auto other = Submit(Unloaded("b", 1));
  EXPECT_EQ(scheduler->TryTakeLoad(), other) << "it is not b's that waits";
  EXPECT_EQ(Take(), Tasks{tasks[0]});
  EXPECT_EQ(scheduler->TryTakeLoad(), tasks[1]);
  tasks[1]->is_loaded = true;
  tasks[1]->traits.cost.held_bytes = 100;
  scheduler->Resubmit(tasks[1]);
  EXPECT_EQ(scheduler->TryTakeLoad(), nullptr);
  EXPECT_TRUE(scheduler->Withdraw(*tasks[1]));
  EXPECT_EQ(scheduler->TryTakeLoad(), tasks[2]);
  scheduler->Ended(*tasks[2]);
  scheduler->Ended(*other);
}

// The loader's thread must be notified too.
TEST_F(SchedulerTest, ALoaderThatWasHeldUpGoesOn) {
  options.max_ready_bytes = 100;
  Start();
  const auto first = Submit(Unloaded("a", 1)), second = Submit(Unloaded("a", 1));
  EXPECT_EQ(scheduler->TakeLoad(), first);
  first->is_loaded = true;
  first->traits.cost.held_bytes = 100;
  scheduler->Resubmit(first);
  std::shared_ptr<Task> loading;
  std::thread loader([&] { loading = scheduler->TakeLoad(); });
  while (scheduler->idle() == 0) std::this_thread::yield();
  EXPECT_TRUE(scheduler->Withdraw(*first));
  loader.join();
  EXPECT_EQ(loading, second);
  scheduler->Ended(*second);
}

// While a loader has the task, its traits are the loader's; who joined then counts from when it waits again.
TEST_F(SchedulerTest, WhoJoinsWhileATaskIsLoadedHasItsPlaceAfterwards) {
  options.max_batch_jobs = 1;
  Start(1);
  const auto task = MakeTask("a", Priority::kLow);
  task->is_loaded = false;
  ASSERT_TRUE(scheduler->Submit(task).ok());
  ASSERT_EQ(scheduler->TakeLoad(), task);
  scheduler->SetWaiters(*task, {{{"b", Priority::kHigh}, {"a", Priority::kLow}}, {}, {}});
  EXPECT_EQ(task->traits.priority, Priority::kLow) << "not yet";
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(scheduler->Submit(MakeTask("c")).ok());
  task->is_loaded = true;
  scheduler->Resubmit(task);
  EXPECT_EQ(scheduler->state().jobs[size_t(Priority::kHigh)], 1u);
  EXPECT_EQ(RunOne(), task);
}

}  // namespace
}  // namespace voxelpipe
