#include "options/options.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <regex>
#include <string>
#include <vector>

#include "base/machine.h"
#include "gtest/gtest.h"
#include "support/resources/temporary_directory.h"

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

// A variable of the environment, as long as it lives.
class Variable {
 public:
  Variable(const char* name, const std::string& value) : name_(name) { setenv(name, value.c_str(), 1); }
  ~Variable() { unsetenv(name_); }

 private:
  const char* name_;
};

// A config file of the running test.
std::string ConfigFile(const std::string& text) {
  static const testing::TemporaryDirectory directory;
  const std::string path =
      directory / (::testing::UnitTest::GetInstance()->current_test_info()->name() + std::string(".toml"));
  std::ofstream(path) << text;
  return path;
}

TEST(OptionsTest, AFlagIsStrongerThanAVariableThanTheFileThanTheDefault) {
  const std::string file = ConfigFile("max-queue = 1\nworkers = 1\nthreads = 1\nlog-level = \"debug\"\n");
  const Variable queue("VOXELPIPE_MAX_QUEUE", "2"), workers("VOXELPIPE_WORKERS", "2");
  const ParseOutcome outcome = Parse({"--config", file.c_str(), "--max-queue", "3"});
  ASSERT_TRUE(outcome.command);
  const ServerOptions& options = outcome.command->options;
  EXPECT_EQ(options.max_queue, 3u);
  EXPECT_EQ(options.workers, 2);
  EXPECT_EQ(options.threads, 1);
  EXPECT_EQ(options.log_level, "debug");
  EXPECT_EQ(options.lame_duck_ms, ServerOptions().lame_duck_ms);
  std::map<std::string, std::string> sources;
  for (const OptionValue& value : outcome.command->values) sources[value.key] = value.value + " from " + value.source;
  EXPECT_EQ(sources["max-queue"], "3 from flag");
  EXPECT_EQ(sources["workers"], "2 from environment VOXELPIPE_WORKERS");
  EXPECT_EQ(sources["threads"], "1 from file " + file);
  EXPECT_EQ(sources["lame-duck-ms"], "500 from default");
}

TEST(OptionsTest, TheFileMayBeNamedByAVariable) {
  const Variable config("VOXELPIPE_CONFIG", ConfigFile("max-queue = 9\n"));
  EXPECT_EQ(Parse({}).command->options.max_queue, 9u);
}

TEST(OptionsTest, WhatTheFileHasWrongIsRefused) {
  for (const char* text : {"max-cue = 1\n", "[section]\nmax-queue = 1\n", "max-queue = many\n", "max-queue = [1, 2]\n",
                           "probe = \"\"\n", "config = \"x\"\n", "max-queue = 1\nmax-queue = 2\n"}) {
    const ParseOutcome outcome = Parse({"--config", ConfigFile(text).c_str()});
    EXPECT_FALSE(outcome.command) << text;
    EXPECT_EQ(outcome.exit_code, 2) << text;
  }
  EXPECT_EQ(Parse({"--config", "/nowhere/at/all.toml"}).exit_code, 2);
}

TEST(OptionsTest, WhatAVariableHasWrongIsRefused) {
  const Variable queue("VOXELPIPE_MAX_QUEUE", "many");
  EXPECT_EQ(Parse({}).exit_code, 2);
  EXPECT_TRUE(Parse({"--max-queue", "1"}).command) << "a flag is stronger, the variable is not looked at";
}

TEST(OptionsTest, ThePrintedOptionsAreAConfigFileOfTheSameValues) {
  const ParseOutcome first = Parse({"--listen", "0.0.0.0:7", "--max-file-bytes", "1MiB", "--reflection", "false"});
  ASSERT_TRUE(first.command);
  const ParseOutcome second = Parse({"--config", ConfigFile(ToConfigText(first.command->values)).c_str()});
  ASSERT_TRUE(second.command);
  ASSERT_EQ(second.command->values.size(), first.command->values.size());
  for (size_t i = 0; i < first.command->values.size(); ++i) {
    EXPECT_EQ(second.command->values[i].value, first.command->values[i].value) << first.command->values[i].key;
  }
  EXPECT_EQ(second.command->options.max_file_bytes, 1u << 20);
  EXPECT_FALSE(second.command->options.reflection);
}

TEST(OptionsTest, AProbeAsksTheGivenOrTheOwnAddress) {
  EXPECT_EQ(Parse({"--probe", "10.0.0.1:7"}).command->probe, "10.0.0.1:7");
  EXPECT_EQ(Parse({"--probe"}).command->probe, "127.0.0.1:50051");
  EXPECT_EQ(Parse({"--listen", "0.0.0.0:7", "--probe"}).command->probe, "127.0.0.1:7");
  EXPECT_EQ(Parse({"--listen", "[::]:7", "--probe"}).command->probe, "[::1]:7");
  EXPECT_EQ(Parse({"--http-listen", "0.0.0.0:9", "--probe"}).command->probe, "http://0.0.0.0:9");
}

TEST(OptionsTest, WhatCannotBeIsRefusedWithExitCodeTwo) {
  for (const std::vector<const char*>& arguments : {std::vector<const char*>{"--backend", "tpu"},
                                                    {"--threads", "-1"},
                                                    {"--workers", "many"},
                                                    {"--nonsense"},
                                                    {"--max-file-bytes", "-1"},
                                                    {"--max-queue-ms", "-1"},
                                                    {"--listen", "nonsense"},
                                                    {"--listen", "::1"},
                                                    {"--listen", "::1:50051"},
                                                    {"--listen", "unix:"},
                                                    {"--listen", ""},
                                                    {"--http-listen", "unix:/run/http"},
                                                    {"--max-file-bytes=-18446744073709551615"},
                                                    {"--max-queue-ms=-18446744073709551615"},
                                                    {"--max-queue=-1"},
                                                    {"--listen", "127.0.0.1:99999"},
                                                    {"--listen", ":50051"},
                                                    {"--listen", ":50051x"},
                                                    {"--http-listen", "9464"},
                                                    {"--config", "/"},
                                                    {"extra"}}) {
    const ParseOutcome outcome = Parse(arguments);
    EXPECT_FALSE(outcome.command) << arguments[0];
    EXPECT_EQ(outcome.exit_code, 2) << arguments[0];
  }
}

TEST(OptionsTest, WhatIsWrongIsSaidOnOneLineWithTheNextStep) {
  for (const auto& [arguments, words] : std::vector<std::pair<std::vector<const char*>, std::string>>{
           {{"--backend", "gpu"}, "--backend: unknown choice 'gpu'; did you mean 'cuda'? known are auto, cpu, cuda"},
           {{"--threads", "many"}, "--threads: 'many' is no number from 0 to 1024"},
           {{"--theads", "1"}, "there is no option '--theads' (did you mean '--threads'?), one argument too many: '1'"},
           {{"--listen"}, "--listen needs a value, HOST:PORT"}}) {
    ::testing::internal::CaptureStderr();
    EXPECT_EQ(Parse(arguments).exit_code, 2);
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "voxelpiped: " + words + "; see 'voxelpiped --help'\n");
  }
}

TEST(OptionsTest, APathThatIsTooLongForASocketIsRefusedWithTheLimit) {
  const std::string longest = "unix:/" + std::string(106, 's'), longer = longest + "s";
  EXPECT_TRUE(Parse({"--listen", longest.c_str()}).command);
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(Parse({"--listen", longer.c_str()}).exit_code, 2);
  EXPECT_NE(::testing::internal::GetCapturedStderr().find("the path of a unix socket has at most 107 bytes, and this "
                                                          "one 108: /ss"),
            std::string::npos);
}

// Each row of the table that names a range "A to B": what lies outside is refused, by a flag and by --check-config
// alike.
TEST(OptionsTest, WhatTheTableForbidsIsRefused) {
  std::ifstream table(VOXELPIPE_OPERATIONS_MD);
  const std::regex row(R"(\| `(--[a-z-]+)` \| `VOXELPIPE_.*[ (]([0-9]+) to ([0-9]+)[^0-9].*)");
  int options = 0;
  for (std::string line; std::getline(table, line);) {
    std::smatch match;
    if (!std::regex_match(line, match, row)) continue;
    ++options;
    const std::string flag = match[1];
    const uint64_t least = std::stoull(match[2]), most = std::stoull(match[3]);
    const auto taken = [&](const std::string& value, bool check) {
      const std::string argument = flag + "=" + value;
      std::vector<const char*> arguments = {argument.c_str()};
      if (check) arguments.push_back("--check-config");
      return Parse(arguments).command.has_value();
    };
    for (const bool check : {false, true}) {
      EXPECT_TRUE(taken(std::to_string(least), check)) << line;
      EXPECT_TRUE(taken(std::to_string(most), check)) << line;
      EXPECT_FALSE(taken(std::to_string(most + 1), check)) << line;
      EXPECT_FALSE(taken(least == 0 ? "-1" : std::to_string(least - 1), check)) << line;
    }
  }
  EXPECT_GT(options, 25);
}

TEST(OptionsTest, AFileLargerThanAllUploadsIsRefusedWhereItWasAskedFor) {
  EXPECT_FALSE(Parse({"--max-file-bytes", "2MiB", "--max-upload-bytes", "1MiB"}).command);
  EXPECT_TRUE(Parse({"--max-file-bytes", "1MiB", "--max-upload-bytes", "1MiB"}).command);
  EXPECT_TRUE(Parse({"--max-upload-bytes", "1MiB"}).command) << "the default gives way";
}

TEST(OptionsTest, AFullPieceLeavesRoomForItsHeader) {
  EXPECT_FALSE(Parse({"--piece-bytes", "4MiB"}).command);
  EXPECT_TRUE(Parse({"--piece-bytes", std::to_string(kMaxPieceBytes).c_str()}).command);
}

TEST(OptionsTest, TheLameDuckIsLongWhereOthersReachTheServer) {
  const auto lame_duck_ms = [](std::vector<const char*> arguments) {
    const ParseOutcome outcome = Parse(std::move(arguments));
    EXPECT_TRUE(outcome.command);
    if (!outcome.command) return uint32_t{0};
    for (const OptionValue& value : outcome.command->values) {
      if (value.key != "lame-duck-ms") continue;
      EXPECT_EQ(value.value, std::to_string(outcome.command->options.lame_duck_ms));
    }
    return outcome.command->options.lame_duck_ms;
  };
  for (const char* local : {"127.0.0.1:0", "localhost:1", "[::1]:1", "unix:/run/x"}) {
    EXPECT_EQ(lame_duck_ms({"--listen", local}), 500u) << local;
  }
  for (const char* open : {"0.0.0.0:0", "[::]:1", "10.0.0.1:1", "voxels.example.com:1"}) {
    EXPECT_EQ(lame_duck_ms({"--listen", open}), 5000u) << open;
  }
  EXPECT_EQ(lame_duck_ms({"--listen", "0.0.0.0:0", "--lame-duck-ms", "7"}), 7u);
}

TEST(OptionsTest, AConnectionsAgeHasTwoNamesAndAUnit) {
  const auto age_ms = [](std::vector<const char*> arguments) {
    const ParseOutcome outcome = Parse(std::move(arguments));
    return outcome.command ? outcome.command->options.max_connection_age_ms : 1u;
  };
  EXPECT_EQ(age_ms({}), 0u);
  EXPECT_EQ(age_ms({"--max-connection-age-ms", "1500"}), 1500u);
  EXPECT_EQ(age_ms({"--max-connection-age", "1500"}), 1500u);
  EXPECT_EQ(age_ms({"--max-connection-age", "30m"}), 1'800'000u);
  EXPECT_EQ(age_ms({"--config", ConfigFile("max-connection-age = \"90s\"\n").c_str()}), 90'000u);
  const Variable age("VOXELPIPE_MAX_CONNECTION_AGE", "2s");
  EXPECT_EQ(age_ms({}), 2'000u);
}

TEST(OptionsTest, EveryWayToNameAnAddressIsTaken) {
  for (const char* address : {"0.0.0.0:0", "[::]:65535", "localhost:50051", "unix:/run/voxelpiped.sock"}) {
    const ParseOutcome outcome = Parse({"--listen", address});
    ASSERT_TRUE(outcome.command) << address;
    EXPECT_EQ(outcome.command->options.listen, address);
  }
  EXPECT_TRUE(Parse({"--http-listen", ""}).command);
}

TEST(OptionsTest, HelpIsNoFailure) {
  const ParseOutcome outcome = Parse({"--help"});
  EXPECT_FALSE(outcome.command);
  EXPECT_EQ(outcome.exit_code, 0);
}

TEST(OptionsTest, LoadingIsIsolatedWhereOtherMachinesReachTheServer) {
  const auto isolated = [](const std::string& listen, const std::string& wish) {
    ServerOptions options;
    options.listen = listen;
    options.isolate_loading = wish;
    return Resolve(options).isolate_loading;
  };
  for (const char* local : {"127.0.0.1:0", "localhost:1", "[::1]:1", "unix:/run/v"}) {
    EXPECT_EQ(isolated(local, "auto"), "off") << local;
    EXPECT_EQ(isolated(local, "on"), "on") << local;
  }
  for (const char* open : {"0.0.0.0:0", "[::]:1", "10.0.0.7:1", "voxels.example:1"}) {
    EXPECT_EQ(isolated(open, "auto"), "on") << open;
    EXPECT_EQ(isolated(open, "off"), "off") << open;
  }
  ServerOptions with_page;
  with_page.web_listen = "127.0.0.1:8080";
  EXPECT_EQ(Resolve(with_page).isolate_loading, "off");
  with_page.web_listen = "0.0.0.0:8080";
  EXPECT_EQ(Resolve(with_page).isolate_loading, "on") << "other machines reach its page";
}

TEST(OptionsTest, ResolvingLeavesNothingToChoose) {
  const ServerOptions options = Resolve(ServerOptions());
  EXPECT_EQ(options.workers, std::min(4, CpuCount()));
  EXPECT_EQ(options.cpu_workers, options.workers);
  EXPECT_GE(options.loaders, 1);
  EXPECT_LE(options.loaders, CpuCount());
  EXPECT_EQ(options.threads, 0) << "the CPUs at any time";
  EXPECT_GT(options.max_queue_bytes, 0u);
  // Sizing in OPERATIONS.md: all of these, what gRPC has and the process itself stay below the container's bound.
  EXPECT_GT(options.max_upload_bytes, 0u);
  EXPECT_GT(options.max_working_bytes, 0u);
  EXPECT_LE(options.max_working_bytes + options.max_upload_bytes + options.max_mesh_store_bytes,
            MemoryBytes() / 16 * 11 + 16);
  ServerOptions given;
  given.loaders = 9;
  given.workers = 7;
  given.max_working_bytes = 1;
  EXPECT_EQ(Resolve(given).loaders, 9);
  EXPECT_EQ(Resolve(given).workers, 7);
  EXPECT_EQ(Resolve(given).max_working_bytes, 1u);
}

// Both say the same; a config that has both keeps what ran on the CPU.
TEST(OptionsTest, WorkersAreBatchesOnTheCpuAndNothingElse) {
  const auto resolved = [](const std::vector<const char*>& arguments) {
    return Resolve(Parse(arguments).command.value().options);
  };
  EXPECT_EQ(resolved({"--workers", "3"}).cpu_workers, 3);
  EXPECT_EQ(resolved({"--cpu-workers", "5"}).workers, 5);
  EXPECT_EQ(resolved({"--workers", "3", "--cpu-workers", "5"}).cpu_workers, 5);
  EXPECT_EQ(resolved({"--workers", "3"}).loaders, resolved({}).loaders);
  EXPECT_EQ(resolved({"--loaders", "3"}).cpu_workers, resolved({}).cpu_workers);
}

TEST(OptionsTest, LoadersHaveMemoryEach) {
  ServerOptions options;
  options.max_working_bytes = 1 << 20;
  EXPECT_EQ(Resolve(options).loaders, 1);
  options.max_working_bytes = uint64_t{1} << 50;
  EXPECT_EQ(Resolve(options).loaders, CpuCount());
}

// The sum of OPERATIONS.md, with the process's own 200 MiB, stays below the memory that there is, from 1 GiB on.
TEST(OptionsTest, TheDefaultsFitIntoTheMemory) {
  if (MemoryBytes() < uint64_t{1} << 30) GTEST_SKIP() << "gRPC's least is more than its part";
  const ServerOptions options = Resolve(ServerOptions());
  const uint64_t sum = options.max_working_bytes + options.max_upload_bytes + options.max_mesh_store_bytes +
                       options.max_transport_bytes + options.result_cache_bytes;
  EXPECT_LE(sum, MemoryBytes() / 4 * 3);
}

}  // namespace
}  // namespace voxelpipe
