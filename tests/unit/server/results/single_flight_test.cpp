#include "results/single_flight.h"

#include <atomic>
#include <latch>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using Flights = SingleFlight<const int, std::string>;

// What one waiter heard.
struct Heard {
  std::vector<std::string> news;
  std::vector<Flights::Answer> answers;

  Flights::Waiter Waiter() {
    return {.done = [this](const Flights::Answer& answer) { answers.push_back(answer); },
            .news = [this](const std::string& text) { news.push_back(text); }};
  }
};

TEST(SingleFlightTest, OneLandingAnswersAllWithTheSameObject) {
  Flights flights;
  Heard a, b, other;
  const auto first = flights.Join("k", a.Waiter());
  const auto second = flights.Join("k", b.Waiter());
  const auto apart = flights.Join("else", other.Waiter());
  EXPECT_TRUE(first.first);
  EXPECT_FALSE(second.first);
  EXPECT_TRUE(apart.first);
  EXPECT_EQ(flights.shared(), 1u);
  EXPECT_EQ(flights.flying(), 2u);
  flights.Tell(first.flight, "half");
  const auto result = std::make_shared<const int>(5);
  flights.Land(first.flight, result);
  for (const Heard* heard : {&a, &b}) {
    ASSERT_EQ(heard->answers.size(), 1u);
    EXPECT_EQ(*heard->answers[0], result);
    EXPECT_EQ(heard->news, std::vector<std::string>{"half"});
  }
  EXPECT_TRUE(other.answers.empty());
  EXPECT_TRUE(other.news.empty());
  flights.Land(first.flight, absl::InternalError("again"));
  EXPECT_EQ(a.answers.size(), 1u) << "a second landing is none";
}

TEST(SingleFlightTest, AnErrorGoesToAll) {
  Flights flights;
  Heard a, b;
  const auto seat = flights.Join("k", a.Waiter());
  flights.Join("k", b.Waiter());
  flights.Land(seat.flight, absl::ResourceExhaustedError("too large"));
  EXPECT_TRUE(absl::IsResourceExhausted(a.answers.at(0).status()));
  EXPECT_TRUE(absl::IsResourceExhausted(b.answers.at(0).status()));
}

TEST(SingleFlightTest, ALandedFlightIsNotJoined) {
  Flights flights;
  Heard a, b;
  flights.Land(flights.Join("k", a.Waiter()).flight, std::make_shared<const int>(1));
  const auto next = flights.Join("k", b.Waiter());
  EXPECT_TRUE(next.first);
  EXPECT_TRUE(b.answers.empty());
  flights.Land(next.flight, std::make_shared<const int>(2));
  EXPECT_EQ(**b.answers.at(0), 2);
}

TEST(SingleFlightTest, WhoLeavesDoesNotDisturbTheOthers) {
  Flights flights;
  Heard a, b;
  int stopped = 0;
  const auto first = flights.Join("k", a.Waiter());
  flights.WhenEmpty(first.flight, [&] { ++stopped; });
  flights.Join("k", b.Waiter());
  flights.Leave(first);
  flights.Leave(first);  // twice is once
  EXPECT_EQ(stopped, 0) << "the other one still waits";
  flights.Land(first.flight, std::make_shared<const int>(3));
  EXPECT_TRUE(a.answers.empty());
  EXPECT_EQ(**b.answers.at(0), 3);
  EXPECT_EQ(stopped, 0);
}

TEST(SingleFlightTest, TheLastOneToLeaveStopsTheWork) {
  Flights flights;
  Heard a, b, c;
  int stopped = 0;
  const auto first = flights.Join("k", a.Waiter());
  flights.WhenEmpty(first.flight, [&] { ++stopped; });
  const auto second = flights.Join("k", b.Waiter());
  flights.Leave(second);
  flights.Leave(first);
  EXPECT_EQ(stopped, 1);
  const auto anew = flights.Join("k", c.Waiter());
  EXPECT_TRUE(anew.first) << "work that is being stopped is not joined";
  flights.Land(first.flight, absl::CancelledError("stopped"));
  EXPECT_TRUE(a.answers.empty());
  EXPECT_TRUE(b.answers.empty());
  EXPECT_TRUE(c.answers.empty());
  EXPECT_EQ(flights.flying(), 1u) << "the old one's landing does not touch the new one";
  flights.Land(anew.flight, std::make_shared<const int>(4));
  EXPECT_EQ(c.answers.size(), 1u);
}

TEST(SingleFlightTest, WorkThatEverybodyLeftBeforeItBeganIsStoppedAtOnce) {
  Flights flights;
  Heard a;
  const auto seat = flights.Join("k", a.Waiter());
  flights.Leave(seat);
  int stopped = 0;
  flights.WhenEmpty(seat.flight, [&] { ++stopped; });
  EXPECT_EQ(stopped, 1);
}

TEST(SingleFlightTest, ALandedFlightKeepsNothingOfItsWaiters) {
  Flights flights;
  const auto held = std::make_shared<int>(0);
  const auto seat = flights.Join("k", {.done = [held](const Flights::Answer&) {}, .news = {}});
  flights.WhenEmpty(seat.flight, [held] {});
  EXPECT_EQ(held.use_count(), 3);
  flights.Land(seat.flight, std::make_shared<const int>(1));
  EXPECT_EQ(held.use_count(), 1) << "seat and waiters often own each other";
}

// Sixteen threads at once, again and again; some leave. Each of the others hears one answer, and there are at most as
// many runs as rounds of waiters.
TEST(SingleFlightTest, ManyThreadsShareTheRuns) {
  constexpr int kThreads = 16, kRounds = 200;
  Flights flights;
  std::atomic<int> runs{0}, answers{0}, left{0};
  for (int round = 0; round < kRounds; ++round) {
    std::latch seated(kThreads);
    std::vector<std::thread> threads;
    std::atomic<int> round_runs{0};
    for (int t = 0; t < kThreads; ++t) {
      threads.emplace_back([&, t] {
        auto heard = std::make_shared<std::atomic<bool>>(false);
        const auto seat = flights.Join("k", {.done =
                                                 [&, heard](const Flights::Answer& answer) {
                                                   EXPECT_EQ(**answer, round);
                                                   EXPECT_FALSE(heard->exchange(true)) << "twice";
                                                   ++answers;
                                                 },
                                             .news = {}});
        seated.arrive_and_wait();  // all are in before the run ends
        if (seat.first) {
          ++round_runs;
          flights.Land(seat.flight, std::make_shared<const int>(round));
        } else if (t % 4 == 0) {
          flights.Leave(seat);
        }
        if (!seat.first && t % 4 == 0 && !heard->load()) ++left;
      });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(round_runs, 1);
    runs += round_runs;
  }
  EXPECT_EQ(runs, kRounds);
  EXPECT_LE(answers, kRounds * kThreads);
  EXPECT_GE(answers + left, kRounds * kThreads) << "nobody was forgotten";
  EXPECT_EQ(flights.flying(), 0u);
}

}  // namespace
}  // namespace voxelpipe
