#include "options.h"

#include <cstdlib>
#include <vector>

#include "base/machine_memory.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

ParseOutcome Parse(std::vector<const char*> arguments) {
  arguments.insert(arguments.begin(), "voxelpiped");
  return ParseCommandLine(int(arguments.size()), arguments.data());
}

TEST(OptionsTest, DefaultsServeOnLoopback) {
  const ParseOutcome outcome = Parse({});
  ASSERT_TRUE(outcome.command);
  EXPECT_EQ(outcome.command->options.listen, "127.0.0.1:50051");
  EXPECT_EQ(outcome.command->options.backend, BackendChoice::kAuto);
  EXPECT_FALSE(outcome.command->probe);
}

TEST(OptionsTest, FlagsAreTaken) {
  const ParseOutcome outcome = Parse({"--listen", "0.0.0.0:0", "--backend", "cpu", "--threads", "3", "--workers", "2",
                                      "--max-queue", "5", "--max-file-bytes", "1MiB", "--max-result-bytes", "77"});
  ASSERT_TRUE(outcome.command);
  const ServerOptions& options = outcome.command->options;
  EXPECT_EQ(options.listen, "0.0.0.0:0");
  EXPECT_EQ(options.backend, BackendChoice::kCpu);
  EXPECT_EQ(options.threads, 3);
  EXPECT_EQ(options.workers, 2);
  EXPECT_EQ(options.max_queue, 5u);
  EXPECT_EQ(options.max_file_bytes, 1u << 20);
  EXPECT_EQ(options.max_result_bytes, 77u);
}

TEST(OptionsTest, AVariableIsTakenAndAFlagIsStronger) {
  setenv("VOXELPIPE_LISTEN", "127.0.0.1:1234", 1);
  EXPECT_EQ(Parse({}).command->options.listen, "127.0.0.1:1234");
  EXPECT_EQ(Parse({"--listen", "127.0.0.1:5"}).command->options.listen, "127.0.0.1:5");
  unsetenv("VOXELPIPE_LISTEN");
}

TEST(OptionsTest, AProbeAsksTheGivenOrTheOwnAddress) {
  EXPECT_EQ(Parse({"--probe", "10.0.0.1:7"}).command->probe, "10.0.0.1:7");
  EXPECT_EQ(Parse({"--probe"}).command->probe, "127.0.0.1:50051");
  EXPECT_EQ(Parse({"--listen", "0.0.0.0:7", "--probe"}).command->probe, "127.0.0.1:7");
  EXPECT_EQ(Parse({"--listen", "[::]:7", "--probe"}).command->probe, "[::1]:7");
}

TEST(OptionsTest, WhatCannotBeIsRefusedWithExitCodeTwo) {
  for (const std::vector<const char*>& arguments : {std::vector<const char*>{"--backend", "tpu"},
                                                    {"--threads", "-1"},
                                                    {"--workers", "many"},
                                                    {"--nonsense"},
                                                    {"extra"}}) {
    const ParseOutcome outcome = Parse(arguments);
    EXPECT_FALSE(outcome.command) << arguments[0];
    EXPECT_EQ(outcome.exit_code, 2) << arguments[0];
  }
}

TEST(OptionsTest, HelpIsNoFailure) {
  const ParseOutcome outcome = Parse({"--help"});
  EXPECT_FALSE(outcome.command);
  EXPECT_EQ(outcome.exit_code, 0);
}

TEST(OptionsTest, ResolvingLeavesNothingToChoose) {
  const ServerOptions options = Resolve(ServerOptions());
  EXPECT_GE(options.workers, 1);
  EXPECT_GE(options.threads, 1);
  EXPECT_GT(options.max_working_bytes, 0u);
  EXPECT_LE(options.max_working_bytes, MemoryBytes());
  ServerOptions given;
  given.workers = 7;
  given.max_working_bytes = 1;
  EXPECT_EQ(Resolve(given).workers, 7);
  EXPECT_EQ(Resolve(given).max_working_bytes, 1u);
}

}  // namespace
}  // namespace voxelpipe
