// The shard of a run: by hand, and from the environment of array jobs.
#include "batch/shard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>

namespace voxelpipe::cli {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(ParseShard, TakesBothWaysOfCounting) {
  for (const char* text : {"0/3", "3/3"}) {
    const absl::StatusOr<Shard> shard = ParseShard(text);
    ASSERT_TRUE(shard.ok()) << shard.status();
    for (size_t item = 0; item < 9; ++item) EXPECT_EQ(shard->Holds(item), item % 3 == 0) << text;
  }
  EXPECT_TRUE(ParseShard("0/1")->Holds(5));
  for (const char* wrong : {"", "1", "1/", "/2", "4/3", "0/0", "-1/3", "1/3x", " 1/3", "1/3/5", "a/b"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ParseShard(wrong).status())) << wrong;
  }
}

TEST(ParseShard, ShardsTogetherHoldEveryItemOnce) {
  for (size_t item = 0; item < 20; ++item) {
    int holders = 0;
    for (const char* text : {"1/4", "2/4", "3/4", "4/4"}) holders += ParseShard(text)->Holds(item) ? 1 : 0;
    EXPECT_EQ(holders, 1) << item;
  }
}

using Variables = std::map<std::string, std::string>;

absl::StatusOr<Shard> Auto(const Variables& variables) {
  return ParseShard("auto", [&](const char* name) {
    const auto found = variables.find(name);
    return found == variables.end() ? std::nullopt : std::optional<std::string>(found->second);
  });
}

std::string AutoError(const Variables& variables) {
  const absl::Status status = Auto(variables).status();
  EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
  return std::string(status.message());
}

Variables Slurm(const char* id, const char* min, const char* count) {
  return {{"SLURM_ARRAY_TASK_ID", id}, {"SLURM_ARRAY_TASK_MIN", min}, {"SLURM_ARRAY_TASK_COUNT", count}};
}

TEST(AutoShard, IsATaskOfAnArrayOfSlurm) {
  for (const char* first : {"0", "1", "17"}) {
    for (int task = 0; task < 4; ++task) {
      const auto shard = Auto(Slurm(std::to_string(std::stoi(first) + task).c_str(), first, "4"));
      ASSERT_TRUE(shard.ok()) << shard.status();
      EXPECT_EQ(shard->index, uint64_t(task));
      EXPECT_EQ(shard->count, 4u);
    }
  }
  Variables steps = Slurm("14", "2", "4");  // 2,6,10,14
  steps["SLURM_ARRAY_TASK_STEP"] = "4";
  EXPECT_EQ(Auto(steps)->index, 3u);
}

TEST(AutoShard, IsAPodOfAnIndexedJob) {
  const auto shard = Auto({{"JOB_COMPLETION_INDEX", "2"}, {"VOXELPIPE_SHARDS", "5"}});
  ASSERT_TRUE(shard.ok()) << shard.status();
  EXPECT_EQ(shard->index, 2u);
  EXPECT_EQ(shard->count, 5u);
}

TEST(AutoShard, WhatIsMissingIsNamed) {
  EXPECT_THAT(AutoError({}), AllOf(HasSubstr("SLURM_ARRAY_TASK_ID"), HasSubstr("JOB_COMPLETION_INDEX")));
  EXPECT_THAT(AutoError({{"SLURM_ARRAY_TASK_ID", "3"}}),
              HasSubstr("SLURM_ARRAY_TASK_MIN and SLURM_ARRAY_TASK_COUNT are not"));
  EXPECT_THAT(AutoError({{"SLURM_ARRAY_TASK_ID", "3"}, {"SLURM_ARRAY_TASK_MIN", "0"}}),
              AllOf(HasSubstr("SLURM_ARRAY_TASK_COUNT is not"), Not(HasSubstr("TASK_MIN"))));
  EXPECT_THAT(AutoError({{"JOB_COMPLETION_INDEX", "0"}}), HasSubstr("VOXELPIPE_SHARDS is not"));
  EXPECT_THAT(AutoError({{"JOB_COMPLETION_INDEX", "0"}, {"VOXELPIPE_SHARDS", ""}}), HasSubstr("VOXELPIPE_SHARDS"));
  EXPECT_THAT(AutoError({{"VOXELPIPE_SHARDS", "4"}}), HasSubstr("neither"));
}

TEST(AutoShard, WhatDoesNotFitIsRefused) {
  EXPECT_THAT(AutoError(Slurm("7", "1", "3")), HasSubstr("without gaps")) << "--array=1,3,7";
  EXPECT_THAT(AutoError(Slurm("x", "0", "3")), HasSubstr("SLURM_ARRAY_TASK_ID='x'"));
  EXPECT_THAT(AutoError(Slurm("0", "1", "3")), HasSubstr("task 0"));
  EXPECT_THAT(AutoError(Slurm("0", "0", "0")), HasSubstr("among 0 tasks"));
  EXPECT_THAT(AutoError(Slurm("0", "0", "-1")), HasSubstr("SLURM_ARRAY_TASK_COUNT='-1'"));
  EXPECT_THAT(AutoError({{"JOB_COMPLETION_INDEX", "5"}, {"VOXELPIPE_SHARDS", "5"}}), HasSubstr("not below"));
  Variables both = Slurm("0", "0", "1");
  both["JOB_COMPLETION_INDEX"] = "0";
  EXPECT_THAT(AutoError(both), HasSubstr("both"));
}

}  // namespace
}  // namespace voxelpipe::cli
