#include "observe/log.h"

#include <algorithm>
#include <limits>
#include <string>

#include "gtest/gtest.h"
#include "support/json/json.h"

namespace voxelpipe {
namespace {

TEST(LogTest, TextQuotesWhatCouldBeTakenForAnotherField) {
  LogLine line("call", LogFormat::kText);
  line.Add("peer", "ipv4:1.2.3.4:5").Add("ms", 1.5).Add("in", uint64_t{7}).Add("error", "a b=\"c\"").Add("none", "");
  EXPECT_EQ(line.text(), "call peer=ipv4:1.2.3.4:5 ms=1.500 in=7 error=\"a b=\\\"c\\\"\" none=\"\"");
}

TEST(LogTest, WhatAStrangerSendsStaysWithinItsField) {
  const std::string hostile = "x\",\"code\":\"OK\"}\n{\xff\x01\\";
  LogLine line("call", LogFormat::kJson);
  line.Add("error", hostile).Add("bad", std::numeric_limits<double>::infinity());
  EXPECT_EQ(line.text().find('\n'), std::string::npos);
  const auto object = testing::ParseJson("{" + line.text() + "}", false);
  ASSERT_TRUE(object.is_object()) << line.text();
  EXPECT_EQ(object.size(), 3u);
  EXPECT_EQ(object["event"], "call");
  EXPECT_EQ(object["bad"], 0);
  LogLine text("call", LogFormat::kText);
  text.Add("error", hostile);
  EXPECT_EQ(text.text().find('\n'), std::string::npos);
}

TEST(LogTest, LevelsHaveTheNamesOfTheOption) {
  EXPECT_EQ(LevelOf("debug"), LogLevel::kDebug);
  EXPECT_EQ(LevelOf("info"), LogLevel::kInfo);
  EXPECT_EQ(LevelOf("warn"), LogLevel::kWarn);
  EXPECT_EQ(LevelOf("error"), LogLevel::kError);
  EXPECT_EQ(LevelOf("off"), LogLevel::kOff);
}

TEST(LogTest, ALongValueIsCut) {
  LogLine line("call", LogFormat::kText);
  line.Add("error", std::string(10'000, 'x'));
  EXPECT_LT(line.text().size(), 400u);
}

// Messages hold paths, and texts of gRPC and of clients.
TEST(LogTest, NoLineHasAControlCharacterOrBeginsAnother) {
  const std::string hostile = "a\x1b]0;b\x07\n2026 info c\x7f\u009b31m\u202e\u2066\u2028\u00e9";
  for (const LogFormat format : {LogFormat::kText, LogFormat::kJson}) {
    ::testing::internal::CaptureStderr();
    StartLog(LogLevel::kInfo, format);
    LogMessage(LogLevel::kWarn, hostile);
    LogLine("call").Add("peer", hostile).Write(LogLevel::kInfo);
    StopLog();
    const std::string written = ::testing::internal::GetCapturedStderr();
    EXPECT_EQ(std::count(written.begin(), written.end(), '\n'), 2) << written;
    for (const char* control : {"\x1b", "\x07", "\x7f", "\u009b", "\u202e", "\u2066", "\u2028"}) {
      EXPECT_EQ(written.find(control), std::string::npos);
    }
    const std::string clean = "a?]0;b??2026 info c??31m???\u00e9";
    const size_t first = written.find(clean);
    EXPECT_NE(first, std::string::npos) << written;
    EXPECT_NE(written.find(clean, first + 1), std::string::npos) << written;
  }
}

TEST(LogTest, FieldsKeepTheirKinds) {
  const LogFields fields = {{"dims", std::string("1x2x3")}, {"batch", uint64_t{4}}, {"queue_ms", .25}};
  LogLine line("call", LogFormat::kJson);
  line.Add(fields);
  EXPECT_EQ(line.text(), "\"event\":\"call\",\"dims\":\"1x2x3\",\"batch\":4,\"queue_ms\":0.250");
}

}  // namespace
}  // namespace voxelpipe
