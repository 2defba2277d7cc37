#include "run/answer_burst.h"

#include <string>
#include <thread>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::hours kLong(1);

TEST(AnswerBurstTest, NothingIsPutOffWithoutOne) {
  bool sent = false;
  EXPECT_FALSE(AnswerBurst::Later(&sent, [&] { sent = true; }));
  EXPECT_FALSE(sent) << "it is the caller's";
}

TEST(AnswerBurstTest, EachSenderSendsOnceAtTheEndInOrder) {
  std::string sent;
  const int a = 0, b = 0;
  {
    const AnswerBurst burst(kLong);
    EXPECT_TRUE(AnswerBurst::Later(&a, [&] { sent += 'a'; }));
    EXPECT_TRUE(AnswerBurst::Later(&b, [&] { sent += 'b'; }));
    EXPECT_TRUE(AnswerBurst::Later(&a, [&] { sent += 'a'; }));
    EXPECT_EQ(sent, "");
  }
  EXPECT_EQ(sent, "ab");
}

TEST(AnswerBurstTest, NothingWaitsBeyondTheLongest) {
  std::string sent;
  const int a = 0;
  const AnswerBurst burst(AnswerBurst::Clock::duration::zero());
  EXPECT_TRUE(AnswerBurst::Later(&a, [&] { sent += '1'; }));
  EXPECT_EQ(sent, "1");
  EXPECT_TRUE(AnswerBurst::Later(&a, [&] { sent += '2'; }));
  EXPECT_EQ(sent, "12");
}

TEST(AnswerBurstTest, ItIsOfItsThreadAlone) {
  const AnswerBurst burst(kLong);
  bool put_off = true;
  std::thread([&] { put_off = AnswerBurst::Later(&put_off, [] {}); }).join();
  EXPECT_FALSE(put_off);
}

TEST(AnswerBurstTest, AnInnerOneSendsItsOwn) {
  std::string sent;
  const int a = 0, b = 0;
  const AnswerBurst outer(kLong);
  EXPECT_TRUE(AnswerBurst::Later(&a, [&] { sent += 'a'; }));
  {
    const AnswerBurst inner(kLong);
    EXPECT_TRUE(AnswerBurst::Later(&b, [&] { sent += 'b'; }));
  }
  EXPECT_EQ(sent, "b");
}

TEST(AnswerBurstTest, WhatIsPutOffWhileSendingIsTheCallersAtTheEnd) {
  const int a = 0;
  bool put_off = true;
  {
    const AnswerBurst burst(kLong);
    EXPECT_TRUE(AnswerBurst::Later(&a, [&] { put_off = AnswerBurst::Later(&a, [] {}); }));
  }
  EXPECT_FALSE(put_off);
}

}  // namespace
}  // namespace voxelpipe
