#include "meshes/claimed_lru.h"

#include <chrono>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using std::chrono::minutes;
using Lru = ClaimedLru<int>;

std::shared_ptr<int> Number(int value) {
  return std::make_shared<int>(value);
}

// Shares hold for ten minutes of a clock that tests turn.
class ClaimedLruTest : public ::testing::Test {
 protected:
  bool Insert(const std::string& key, uint64_t bytes, const std::string& client) {
    return lru_.Insert(key, Number(0), bytes, client).value != nullptr;
  }
  bool Has(const std::string& key) { return lru_.Peek(key) != nullptr; }

  Lru::Clock::time_point now_ = Lru::Clock::now();
  Lru lru_{100, minutes(10), [this] { return now_; }};
};

TEST_F(ClaimedLruTest, OfOneClientTheLongestUnusedGoes) {
  for (const char* key : {"a", "b", "c"}) ASSERT_TRUE(Insert(key, 30, "x"));
  ASSERT_NE(lru_.Use("a"), nullptr);
  ASSERT_TRUE(Insert("d", 30, "x"));
  EXPECT_TRUE(Has("a") && Has("c") && Has("d"));
  EXPECT_FALSE(Has("b"));
  EXPECT_EQ(lru_.stats().evictions, 1u);
  EXPECT_EQ(lru_.stats().bytes, 90u);
}

TEST_F(ClaimedLruTest, OthersInsertsLeaveAClientWhatItUsedLastWithinItsShare) {
  for (const char* key : {"x1", "x2", "x3"}) ASSERT_TRUE(Insert(key, 20, "x"));
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(Insert("y" + std::to_string(i), 20, "y"));
  EXPECT_FALSE(Has("x1")) << "beyond the share";
  EXPECT_TRUE(Has("x2") && Has("x3"));
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(Insert("z" + std::to_string(i), 20, "z"));
  EXPECT_TRUE(Has("x3")) << "of three clients a share is a third";
  EXPECT_FALSE(Has("x2"));
  EXPECT_TRUE(Has("y49"));
  EXPECT_LE(lru_.stats().bytes, 100u);
}

TEST_F(ClaimedLruTest, WhatHasNoRoomChangesNothingAndSaysHowMuchThereIs) {
  ASSERT_TRUE(Insert("x1", 25, "x"));
  ASSERT_TRUE(Insert("x2", 25, "x"));
  ASSERT_TRUE(Insert("y1", 10, "y"));
  const Lru::Inserted refused = lru_.Insert("y2", Number(0), 60, "y");
  EXPECT_EQ(refused.value, nullptr);
  EXPECT_EQ(refused.room, 50u);
  EXPECT_TRUE(Has("x1") && Has("x2") && Has("y1"));
  EXPECT_EQ(lru_.stats().bytes, 60u);
  EXPECT_EQ(lru_.stats().evictions, 0u);
  EXPECT_TRUE(Insert("y2", 50, "y")) << "its own older ones make room";
  EXPECT_FALSE(Has("y1"));
  EXPECT_EQ(lru_.Insert("z", Number(0), 101, "z").room, 100u);
}

TEST_F(ClaimedLruTest, WhatNobodyUsedForLongIsNobodysShare) {
  ASSERT_TRUE(Insert("x", 50, "x"));
  now_ += minutes(9);
  EXPECT_FALSE(Insert("y", 60, "y"));
  now_ += minutes(1);
  EXPECT_TRUE(Insert("y", 60, "y"));
  EXPECT_FALSE(Has("x"));
}

TEST_F(ClaimedLruTest, WhatOneClientPutsOutStaysForTheNextClaimant) {
  ASSERT_TRUE(Insert("shared", 20, "x"));
  ASSERT_NE(lru_.Claim("shared", "y"), nullptr);
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(Insert("x" + std::to_string(i), 20, "x"));
  EXPECT_TRUE(Has("shared")) << "x had no room for it, y has";
  std::shared_ptr<int> gone;
  EXPECT_EQ(lru_.Release("shared", "x", gone), Lru::Released::kNoClaim);
  EXPECT_EQ(lru_.Release("shared", "y", gone), Lru::Released::kGone);
  EXPECT_NE(gone, nullptr);
}

TEST_F(ClaimedLruTest, AClaimTakenBackLeavesTheBytesToTheOther) {
  ASSERT_TRUE(Insert("shared", 60, "x"));
  ASSERT_NE(lru_.Claim("shared", "y"), nullptr);
  std::shared_ptr<int> gone;
  EXPECT_EQ(lru_.Release("shared", "x", gone), Lru::Released::kStays);
  EXPECT_EQ(gone, nullptr);
  EXPECT_TRUE(Insert("x", 40, "x"));
  EXPECT_EQ(lru_.stats().bytes, 100u);
  EXPECT_TRUE(Insert("x2", 10, "x"));
  EXPECT_FALSE(Has("shared")) << "y holds more than its share";
}

TEST_F(ClaimedLruTest, WhatGrowsPutsOthersOutOrGoesItself) {
  const auto a = lru_.Insert("a", Number(1), 10, "x").value;
  ASSERT_TRUE(Insert("b", 45, "y"));
  lru_.Resize("a", a.get(), 55);
  EXPECT_TRUE(Has("a") && Has("b"));
  lru_.Resize("a", a.get(), 60);
  EXPECT_FALSE(Has("a")) << "b is within its share";
  EXPECT_TRUE(Has("b"));
  EXPECT_EQ(lru_.stats().bytes, 45u);
  lru_.Resize("a", a.get(), 1);  // no longer kept
  EXPECT_EQ(lru_.stats().bytes, 45u);
}

TEST_F(ClaimedLruTest, ASmallerLimitPutsOutWhatIsBeyondShares) {
  for (const char* key : {"x1", "x2", "x3"}) ASSERT_TRUE(Insert(key, 25, "x"));
  ASSERT_TRUE(Insert("y", 25, "y"));
  lru_.set_limit_bytes(50);
  EXPECT_TRUE(Has("x3") && Has("y"));
  EXPECT_FALSE(Has("x1") || Has("x2"));
  EXPECT_EQ(lru_.limit_bytes(), 50u);
  EXPECT_FALSE(Insert("x4", 51, "x"));
  lru_.set_limit_bytes(0);
  EXPECT_EQ(lru_.stats().bytes, 0u);
}

TEST_F(ClaimedLruTest, WhateverComesTheBytesAddUpAndSharesHold) {
  std::mt19937 random(7);
  for (int i = 0; i < 20'000; ++i) {
    const std::string key = std::to_string(random() % 60), client(1, char('a' + random() % 4));
    std::shared_ptr<int> gone;
    switch (random() % 6) {
      case 0:
      case 1: lru_.Insert(key, Number(0), random() % 40, client); break;
      case 2: lru_.Claim(key, client); break;
      case 3: lru_.Use(key); break;
      case 4: lru_.Release(key, client, gone); break;
      default:
        if (const auto value = lru_.Peek(key)) lru_.Resize(key, value.get(), random() % 60);
    }
    if (random() % 50 == 0) lru_.Erase(key);
    ASSERT_LE(lru_.stats().bytes, 100u);
  }
  for (int key = 0; key < 60; ++key) lru_.Erase(std::to_string(key));
  EXPECT_EQ(lru_.stats().bytes, 0u);
  EXPECT_EQ(lru_.stats().entries, 0u);
}

TEST_F(ClaimedLruTest, AListFollowsTheOrderOfInserts) {
  for (const char* key : {"a", "b", "c", "d"}) ASSERT_TRUE(Insert(key, 10, *key == 'c' ? "y" : "x"));
  ASSERT_NE(lru_.Use("a"), nullptr);
  ASSERT_TRUE(Insert("b", 10, "y")) << "a claim on what is there";
  const std::string x = "x", y = "y";
  const auto numbers = [&](const std::string* client, std::optional<uint64_t> before, size_t count) {
    std::vector<uint64_t> list;
    for (const Lru::Listed& listed : lru_.List(client, before, count)) list.push_back(listed.number);
    return list;
  };
  using Numbers = std::vector<uint64_t>;
  EXPECT_EQ(numbers(nullptr, {}, 10), (Numbers{3, 2, 1, 0}));
  EXPECT_EQ(numbers(&x, {}, 10), (Numbers{3, 1, 0}));
  EXPECT_EQ(numbers(&y, {}, 10), (Numbers{2, 1}));
  EXPECT_EQ(numbers(nullptr, 3, 2), (Numbers{2, 1}));
  EXPECT_EQ(numbers(nullptr, 0, 2), Numbers{});
  EXPECT_EQ(numbers(nullptr, {}, 0), Numbers{});
  // What comes again after it has gone is new.
  ASSERT_NE(lru_.Erase("a"), nullptr);
  ASSERT_TRUE(Insert("a", 10, "x"));
  EXPECT_EQ(numbers(nullptr, {}, 10), (Numbers{4, 3, 2, 1}));
}

}  // namespace
}  // namespace voxelpipe
