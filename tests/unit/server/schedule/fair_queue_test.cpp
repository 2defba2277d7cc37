#include "schedule/fair_queue.h"

#include <algorithm>
#include <map>
#include <random>
#include <set>

#include "gtest/gtest.h"
#include "waiting_task.h"

namespace voxelpipe {
namespace {

using testing::MakeTask;
constexpr auto kAll = FairQueue::kAllLanes;

class Queue : public FairQueue {
 public:
  Queue() : FairQueue({16, 4, 1}) {}
  std::shared_ptr<Task> Add(const std::string& client, Priority priority, double ms, size_t lane = 0) {
    std::shared_ptr<Task> task = MakeTask(client, priority, ms);
    Push(task, lane, priority, client, ms);
    return task;
  }
};

TEST(FairQueueTest, OneClientsTasksComeInTheirOrderAcrossLanes) {
  Queue queue;
  std::vector<std::shared_ptr<Task>> tasks;
  for (int i = 0; i < 30; ++i) tasks.push_back(queue.Add("a", Priority::kNormal, 1, size_t(i % 3)));
  for (const auto& task : tasks) EXPECT_EQ(queue.Pop(kAll), task);
  EXPECT_EQ(queue.Pop(kAll), nullptr);
  EXPECT_EQ(queue.size(), 0u);
  EXPECT_EQ(queue.lanes(), 0u);
}

TEST(FairQueueTest, OnlyTheLanesThatAreNamedAreTakenFrom) {
  Queue queue;
  const auto first = queue.Add("a", Priority::kHigh, 1, 2);
  const auto second = queue.Add("a", Priority::kLow, 1, 5);
  EXPECT_EQ(queue.lanes(), (1u << 2) | (1u << 5));
  EXPECT_EQ(queue.Front(1u << 3), nullptr);
  size_t lane = 0;
  EXPECT_EQ(queue.Front(1u << 5 | 1u << 3, &lane), second.get());
  EXPECT_EQ(lane, 5u);
  EXPECT_EQ(queue.Pop(1u << 5), second);
  EXPECT_EQ(queue.Pop(1u << 5), nullptr);
  EXPECT_EQ(queue.Pop(kAll), first);
}

TEST(FairQueueTest, ClientsArePassedOver) {
  Queue queue;
  const auto a = queue.Add("a", Priority::kHigh, 1, 1);
  const auto b = queue.Add("b", Priority::kNormal, 1, 2);
  const auto c = queue.Add("c", Priority::kNormal, 1, 2);
  size_t lane = 0;
  EXPECT_EQ(queue.Front(kAll, &lane, [](const std::string& client) { return client == "a"; }), b.get());
  EXPECT_EQ(lane, 2u);
  EXPECT_EQ(queue.Front(kAll, &lane, [](const std::string&) { return true; }), nullptr);
  EXPECT_EQ(queue.Pop(kAll, [](const std::string& client) { return client != "c"; }), c);
  EXPECT_EQ(queue.Pop(kAll), a);
  EXPECT_EQ(queue.Pop(kAll), b);
}

TEST(FairQueueTest, AThousandTasksOfOneClientDoNotHoldUpAnothersOne) {
  Queue queue;
  for (int i = 0; i < 1000; ++i) queue.Add("greedy", Priority::kNormal, 1);
  for (int i = 0; i < 100; ++i) queue.Pop(kAll);
  const auto one = queue.Add("modest", Priority::kNormal, 1);
  int before = 0;
  while (queue.Pop(kAll) != one) ++before;
  EXPECT_LE(before, 1);
}

TEST(FairQueueTest, ClientsShareTheWorkNotTheNumberOfTasks) {
  Queue queue;
  for (int i = 0; i < 100; ++i) queue.Add("large", Priority::kNormal, 10);
  for (int i = 0; i < 1000; ++i) queue.Add("small", Priority::kNormal, 1);
  std::map<std::string, double> served;
  for (int i = 0; i < 220; ++i) {
    const auto task = queue.Pop(kAll);
    served[task->traits.client] += task->traits.cost.run_ms;
  }
  EXPECT_NEAR(served["large"], served["small"], 20);
}

TEST(FairQueueTest, PrioritiesShareTheWorkByTheirWeights) {
  Queue queue;
  for (int i = 0; i < 3000; ++i) {
    for (const Priority p : {Priority::kLow, Priority::kNormal, Priority::kHigh}) queue.Add("a", p, 1);
  }
  std::map<Priority, int> served;
  for (int i = 0; i < 2100; ++i) ++served[queue.Pop(kAll)->traits.priority];
  EXPECT_NEAR(served[Priority::kHigh], 1600, 5);
  EXPECT_NEAR(served[Priority::kNormal], 400, 5);
  EXPECT_NEAR(served[Priority::kLow], 100, 5);
}

TEST(FairQueueTest, AHighTaskThatComesLateIsNext) {
  Queue queue;
  for (int i = 0; i < 100; ++i) queue.Add("a", Priority::kLow, 50);
  for (int i = 0; i < 10; ++i) queue.Pop(kAll);
  const auto high = queue.Add("a", Priority::kHigh, 50);
  EXPECT_EQ(queue.Pop(kAll), high);
}

TEST(FairQueueTest, WhoWasAwayOrHeldBackHasSavedNothing) {
  Queue queue;
  queue.Add("held", Priority::kNormal, 1, 1);  // in a lane without workers
  for (int i = 0; i < 1000; ++i) queue.Add("busy", Priority::kNormal, 1, 0);
  for (int i = 0; i < 500; ++i) queue.Pop(1);
  for (int i = 0; i < 100; ++i) queue.Add("held", Priority::kNormal, 1, 0);
  std::map<std::string, int> served;
  for (int i = 0; i < 100; ++i) ++served[queue.Pop(1)->traits.client];
  EXPECT_NEAR(served["held"], 50, 2);
}

TEST(FairQueueTest, ComingBackDoesNotCancelADebt) {
  Queue queue;
  for (int i = 0; i < 100; ++i) queue.Add("steady", Priority::kNormal, 1);
  queue.Add("sly", Priority::kNormal, 50);
  std::map<std::string, double> served;
  for (int i = 0; i < 60; ++i) {  // one at a time, and back at once
    const auto task = queue.Pop(kAll);
    served[task->traits.client] += task->traits.cost.run_ms;
    if (task->traits.client == "sly") queue.Add("sly", Priority::kNormal, 50);
  }
  EXPECT_LE(served["sly"], 100);
}

TEST(FairQueueTest, ARaisedTaskTakesTheHigherOnesTurn) {
  Queue queue;
  for (int i = 0; i < 100; ++i) queue.Add("a", Priority::kHigh, 1);
  const auto low = queue.Add("b", Priority::kLow, 1);
  EXPECT_TRUE(queue.Raise(*low));
  EXPECT_TRUE(queue.Raise(*low));
  EXPECT_FALSE(queue.Raise(*low)) << "nothing is higher";
  EXPECT_EQ(queue.size(Priority::kHigh), 101u);
  int before = 0;
  while (queue.Pop(kAll) != low) ++before;
  EXPECT_LE(before, 1);
}

TEST(FairQueueTest, SumsAndSizesFollowEveryWayInAndOut) {
  Queue queue;
  std::mt19937 random(1);
  std::vector<std::shared_ptr<Task>> here;
  for (int i = 0; i < 20000; ++i) {
    const unsigned kind = random() % 8;
    if (kind < 4) {
      here.push_back(queue.Add(std::string(1, char('a' + random() % 7)), Priority(random() % 3), double(random() % 10),
                               random() % FairQueue::kLanes));
    } else if (kind == 4 && !here.empty()) {
      const size_t n = random() % here.size();
      EXPECT_EQ(queue.Remove(*here[n]), here[n]);
      EXPECT_EQ(queue.Remove(*here[n]), nullptr);
      here.erase(here.begin() + long(n));
    } else if (kind == 5 && !here.empty()) {
      const auto& task = here[random() % here.size()];
      if (random() % 2 == 0) {
        queue.Raise(*task);
      } else {
        queue.Move(*task, random() % FairQueue::kLanes);
      }
    } else if (const auto lanes = FairQueue::Lanes(random()) & kAll; const auto task = queue.Pop(lanes)) {
      here.erase(std::find(here.begin(), here.end(), task));
    } else {
      EXPECT_EQ(queue.lanes() & lanes, 0u);
    }
    double ms = 0;
    for (const auto& task : here) ms += task->traits.cost.run_ms;
    ASSERT_EQ(queue.size(), here.size());
    ASSERT_NEAR(queue.waiting_ms(), ms, 1e-6);
  }
  size_t of_clients = 0;
  for (char c = 'a'; c < 'h'; ++c) of_clients += queue.WaitingOf(std::string(1, c));
  EXPECT_EQ(of_clients, here.size());
}

TEST(FairQueueTest, WhatIsAheadIsTheClientsOwnAndItsShareOfOthers) {
  Queue queue;
  EXPECT_EQ(queue.AheadMs(Priority::kNormal, "a", 5), 0);
  for (int i = 0; i < 100; ++i) queue.Add("greedy", Priority::kNormal, 10);
  EXPECT_NEAR(queue.AheadMs(Priority::kNormal, "modest", 10), 20, 1e-9) << "one turn of each";
  EXPECT_NEAR(queue.AheadMs(Priority::kNormal, "greedy", 10), 1000, 1e-9);
  EXPECT_NEAR(queue.AheadMs(Priority::kHigh, "modest", 16), 4, 1e-9)
      << "a quarter of its own time goes to the normal ones";
  EXPECT_NEAR(queue.AheadMs(Priority::kLow, "modest", 10), 40, 1e-9);
}

TEST(FairQueueTest, ATaskOfSeveralClientsIsTakenWhenTheFirstOfThemHasItsTurn) {
  Queue queue;
  std::vector<std::shared_ptr<Task>> before;
  for (int i = 0; i < 10; ++i) before.push_back(queue.Add("busy", Priority::kNormal, 1));
  const auto task = queue.Add("busy", Priority::kNormal, 1);
  const std::vector<FairQueue::Stand> both = {{"busy", Priority::kNormal}, {"idle", Priority::kNormal}};
  ASSERT_TRUE(queue.SetStands(*task, both));
  EXPECT_EQ(queue.size(), 11u);
  EXPECT_EQ(queue.size(Priority::kNormal), 11u);
  EXPECT_EQ(queue.waiting_ms(), 11);
  int turns = 1;
  while (queue.Pop(kAll) != task) ++turns;
  EXPECT_LE(turns, 2);
  EXPECT_EQ(queue.WaitingOf("idle"), 0u);
  for (; queue.size() > 0; ++turns) EXPECT_NE(queue.Pop(kAll), task) << "once";
  EXPECT_EQ(turns, 11);
  EXPECT_EQ(queue.lanes(), 0u);
}

TEST(FairQueueTest, WhoIsServedFirstPaysForATaskOfSeveral) {
  Queue queue;
  const auto task = queue.Add("a", Priority::kNormal, 100);
  const auto of_a = queue.Add("a", Priority::kNormal, 1);
  const std::vector<FairQueue::Stand> stands = {{"a", Priority::kNormal}, {"b", Priority::kHigh}};
  ASSERT_TRUE(queue.SetStands(*task, stands));
  const auto of_b = queue.Add("b", Priority::kNormal, 1);
  EXPECT_EQ(queue.Pop(kAll), task) << "as b's, of high priority";
  EXPECT_EQ(queue.Pop(kAll), of_a) << "a has paid nothing";
  EXPECT_EQ(queue.Pop(kAll), of_b);
}

TEST(FairQueueTest, PlacesThatStayKeepTheirTurnAndOthersGo) {
  Queue queue;
  const auto task = queue.Add("a", Priority::kLow, 5);
  const auto other = queue.Add("c", Priority::kLow, 1);
  using Stands = std::vector<FairQueue::Stand>;
  ASSERT_TRUE(queue.SetStands(*task, Stands{{"a", Priority::kLow}, {"b", Priority::kHigh}}));
  ASSERT_TRUE(queue.SetStands(*task, Stands{{"b", Priority::kHigh}}));
  EXPECT_EQ(queue.WaitingOf("a"), 0u);
  EXPECT_EQ(queue.size(Priority::kLow), 1u);
  EXPECT_EQ(queue.size(Priority::kHigh), 1u) << "the place that is left counts";
  EXPECT_EQ(queue.waiting_ms(), 6);
  ASSERT_TRUE(queue.SetStands(*task, Stands{{"b", Priority::kHigh}, {"a", Priority::kLow}}));
  ASSERT_TRUE(queue.Raise(*task)) << "its low place";
  ASSERT_TRUE(queue.SetStands(*task, Stands{{"a", Priority::kLow}}));
  EXPECT_EQ(queue.size(Priority::kNormal), 1u) << "which stays raised";
  queue.Move(*task, 3);
  EXPECT_EQ(queue.size(3), 1u);
  EXPECT_EQ(queue.Remove(*task), task);
  EXPECT_FALSE(queue.SetStands(*task, Stands{{"a", Priority::kLow}}));
  EXPECT_EQ(queue.Pop(kAll), other);
  EXPECT_EQ(queue.waiting_ms(), 0);
}

TEST(FairQueueTest, WhateverPlacesTasksHaveEachLeavesOnce) {
  std::mt19937 random(3);
  Queue queue;
  std::set<std::shared_ptr<Task>> there;
  const auto pick = [&] { return *std::next(there.begin(), ptrdiff_t(random() % there.size())); };
  const auto some_stands = [&] {
    std::vector<FairQueue::Stand> stands;
    for (size_t wanted = 1 + random() % 4; stands.size() < wanted;) {
      const FairQueue::Stand stand{std::string(1, char('a' + random() % 3)), Priority(random() % kPriorities)};
      if (std::find(stands.begin(), stands.end(), stand) == stands.end()) stands.push_back(stand);
    }
    return stands;
  };
  for (int i = 0; i < 20'000; ++i) {
    const auto choice = random() % 8;
    if (there.empty() || choice < 2) {
      there.insert(
          queue.Add("a", Priority(random() % kPriorities), double(1 + random() % 5), random() % FairQueue::kLanes));
    } else if (choice < 4) {
      EXPECT_TRUE(queue.SetStands(*pick(), some_stands()));
    } else if (choice == 4) {
      queue.Raise(*pick());
    } else if (choice == 5) {
      queue.Move(*pick(), random() % FairQueue::kLanes);
    } else if (choice == 6) {
      const auto task = pick();
      EXPECT_EQ(queue.Remove(*task), task);
      there.erase(task);
    } else {
      const auto task = queue.Pop(kAll);
      EXPECT_EQ(there.erase(task), 1u);
    }
    ASSERT_EQ(queue.size(), there.size());
    size_t of_priorities = 0;
    for (size_t p = 0; p < kPriorities; ++p) of_priorities += queue.size(Priority(p));
    ASSERT_EQ(of_priorities, there.size());
  }
  while (const auto task = queue.Pop(kAll)) EXPECT_EQ(there.erase(task), 1u);
  EXPECT_TRUE(there.empty());
  EXPECT_EQ(queue.lanes(), 0u);
  EXPECT_EQ(queue.waiting_ms(), 0);
}

}  // namespace
}  // namespace voxelpipe
