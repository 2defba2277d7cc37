#include "meshes/byte_lru.h"

#include <memory>
#include <string>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

std::shared_ptr<int> Int(int value) {
  return std::make_shared<int>(value);
}

TEST(ByteLruTest, TheLongestUnusedGoesFirst) {
  ByteLru<int> lru(30);
  for (const char* key : {"a", "b", "c"}) ASSERT_NE(lru.Insert(key, Int(1), 10), nullptr);
  EXPECT_NE(lru.Use("a"), nullptr);
  ASSERT_NE(lru.Insert("d", Int(2), 10), nullptr);
  EXPECT_EQ(lru.Peek("b"), nullptr) << "unused for longest";
  EXPECT_NE(lru.Peek("c"), nullptr);
  ASSERT_NE(lru.Insert("e", Int(3), 10), nullptr);
  EXPECT_EQ(lru.Peek("c"), nullptr) << "looking is not using";
  EXPECT_NE(lru.Touch("a"), nullptr);
  ASSERT_NE(lru.Insert("f", Int(4), 20), nullptr);
  EXPECT_NE(lru.Peek("a"), nullptr) << "touching is";
  EXPECT_EQ(lru.Peek("d"), nullptr);
  EXPECT_EQ(lru.Peek("e"), nullptr);
  EXPECT_EQ(lru.stats().evictions, 4u);
}

TEST(ByteLruTest, NeverHoldsMoreThanItsBytes) {
  ByteLru<int> lru(100);
  for (int i = 0; i < 200; ++i) {
    EXPECT_NE(lru.Insert(std::to_string(i), Int(i), uint64_t(i % 101)), nullptr);
    EXPECT_LE(lru.stats().bytes, 100u);
  }
  EXPECT_EQ(lru.Insert("large", Int(0), 101), nullptr);
  EXPECT_EQ(lru.Insert("huge", Int(0), ~uint64_t{0}), nullptr);
  EXPECT_EQ(lru.Peek("large"), nullptr);
  EXPECT_GT(lru.stats().entries, 0u) << "what is too large puts nothing out";
}

TEST(ByteLruTest, ASmallerLimitPutsOutWhatDoesNotFit) {
  ByteLru<int> lru(30);
  for (const char* key : {"a", "b", "c"}) ASSERT_NE(lru.Insert(key, Int(1), 10), nullptr);
  lru.set_limit_bytes(15);
  EXPECT_EQ(lru.Peek("a"), nullptr);
  EXPECT_EQ(lru.Peek("b"), nullptr);
  EXPECT_NE(lru.Peek("c"), nullptr);
  EXPECT_EQ(lru.Insert("d", Int(1), 20), nullptr);
  lru.set_limit_bytes(30);
  EXPECT_NE(lru.Insert("d", Int(1), 20), nullptr);
  EXPECT_NE(lru.Peek("c"), nullptr);
}

TEST(ByteLruTest, AnEqualKeyKeepsTheFirstValue) {
  ByteLru<int> lru(100);
  const auto first = lru.Insert("a", Int(1), 10);
  const auto second = lru.Insert("a", Int(2), 90);
  EXPECT_EQ(second, first);
  EXPECT_EQ(lru.stats().bytes, 10u);
  EXPECT_EQ(lru.stats().entries, 1u);
}

TEST(ByteLruTest, WhatIsInUseLivesOn) {
  ByteLru<int> lru(10);
  const auto held = lru.Insert("a", Int(7), 10);
  const std::weak_ptr<int> other = lru.Insert("b", Int(8), 10);
  EXPECT_EQ(lru.Peek("a"), nullptr);
  EXPECT_EQ(*held, 7);
  EXPECT_FALSE(other.expired());
  EXPECT_NE(lru.Erase("b"), nullptr);
  EXPECT_TRUE(other.expired()) << "nobody held it";
  EXPECT_EQ(lru.Erase("b"), nullptr);
  EXPECT_EQ(lru.stats().bytes, 0u);
}

TEST(ByteLruTest, AValueThatGrowsMakesRoomForItself) {
  ByteLru<int> lru(30);
  const auto a = lru.Insert("a", Int(1), 10);
  ASSERT_NE(lru.Insert("b", Int(2), 10), nullptr);
  ASSERT_NE(lru.Insert("c", Int(3), 10), nullptr);
  lru.Resize("a", a.get(), 15);
  EXPECT_NE(lru.Peek("a"), nullptr);
  EXPECT_EQ(lru.Peek("b"), nullptr);
  EXPECT_EQ(lru.stats().bytes, 25u);
  const int other = 0;
  lru.Resize("a", &other, 20);
  EXPECT_EQ(lru.stats().bytes, 25u) << "another value of that key took the place";
  lru.Resize("a", a.get(), 31);
  EXPECT_EQ(lru.stats().entries, 0u) << "larger than everything";
  EXPECT_EQ(*a, 1);
}

TEST(ByteLruTest, CountsHitsAndMisses) {
  ByteLru<int> lru(30);
  lru.Use("a");
  lru.Insert("a", Int(1), 10);
  lru.Use("a");
  lru.Use("a");
  lru.Touch("b");
  lru.Peek("b");
  EXPECT_EQ(lru.stats().hits, 2u);
  EXPECT_EQ(lru.stats().misses, 1u);
}

}  // namespace
}  // namespace voxelpipe
