// Which files the command line tool writes and reads, and how.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <future>
#include <thread>

#include "cli_process.h"
#include "cli_runner.h"
#include "support/json/json.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::CliOutcome;
using testing::CliProcess;
using ::testing::HasSubstr;
using testing::LineCount;
using ::testing::Not;
using testing::ParseJson;
using testing::ReadFile;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliFiles : public ::testing::Test {
 protected:
  CliFiles() : box_(directory_ / "box.glb") { WriteBoxGlb(box_, 1, 2, 4); }

  CliOutcome Voxelize(std::vector<std::string> options, const std::string& prefix = "") {
    options.insert(options.begin(), {"voxelize", box_, "--resolution", "32", "--json"});
    return RunCli(options, prefix);
  }
  std::string TextOf(const std::string& name) {
    const std::vector<uint8_t> bytes = ReadFile(directory_ / name);
    return {bytes.begin(), bytes.end()};
  }

  TemporaryDirectory directory_;
  std::string box_;
};

TEST_F(CliFiles, ARawFileIsDescribedBesideIt) {
  const CliOutcome outcome = Voxelize({"-o", directory_ / "out.raw"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json summary = ParseJson(outcome.out);
  const json about = ParseJson(TextOf("out.raw.json"));
  for (const char* key : {"dims", "origin", "voxel_size", "hash"}) EXPECT_EQ(about[key], summary[key]) << key;
  EXPECT_EQ(summary["files"], json({directory_ / "out.raw", directory_ / "out.raw.json"}));
  EXPECT_EQ(about["targets"][0]["bytes"], fs::file_size(directory_ / "out.raw"));
}

TEST_F(CliFiles, AFifoALinkAndAModeStayWhatTheyWere) {
  ASSERT_EQ(Voxelize({"-o", directory_ / "plain.npy"}).exit_code, 0);
  const std::string expected = TextOf("plain.npy");

  ASSERT_EQ(mkfifo((directory_ / "pipe.npy").c_str(), 0600), 0);
  std::future<std::string> reader = std::async(std::launch::async, [&] { return TextOf("pipe.npy"); });
  EXPECT_EQ(Voxelize({"-o", directory_ / "pipe.npy"}).exit_code, 0);
  EXPECT_TRUE(reader.get() == expected);
  EXPECT_TRUE(fs::is_fifo(directory_ / "pipe.npy"));

  std::ofstream(directory_ / "real.npy") << "old";
  fs::permissions(directory_ / "real.npy", fs::perms(0600));
  fs::create_symlink("real.npy", directory_ / "link.npy");
  EXPECT_EQ(Voxelize({"-o", directory_ / "link.npy"}).exit_code, 0);
  EXPECT_TRUE(fs::is_symlink(directory_ / "link.npy"));
  EXPECT_TRUE(TextOf("real.npy") == expected);
  EXPECT_EQ(fs::status(directory_ / "real.npy").permissions(), fs::perms(0600));

  fs::create_symlink("/dev/null", directory_ / "null.npy");
  EXPECT_EQ(Voxelize({"-o", directory_ / "null.npy"}).exit_code, 0);
  EXPECT_TRUE(fs::is_symlink(directory_ / "null.npy"));
}

TEST_F(CliFiles, AReaderThatGoesAwayIsOneError) {
  ASSERT_EQ(mkfifo((directory_ / "pipe.npy").c_str(), 0600), 0);
  std::future<void> reader = std::async(std::launch::async, [&] { std::ifstream(directory_ / "pipe.npy").get(); });
  const CliOutcome outcome = RunCli({"voxelize", box_, "--resolution", "128", "-o", directory_ / "pipe.npy"});
  reader.get();
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("Broken pipe"));
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
}

TEST_F(CliFiles, TheLongestNameOfAFileIsNotTooLong) {
  for (const char* extension : {".npy", ".npz", ".raw", ".png"}) {
    const std::string name = std::string(255 - 4, 'n') + extension;
    const CliOutcome outcome = Voxelize({"-o", directory_ / name});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_TRUE(fs::exists(directory_ / name));
  }
}

TEST_F(CliFiles, AFileSizeLimitIsAnErrorAndLeavesNothing) {
  const CliOutcome outcome =
      RunCli({"voxelize", box_, "--resolution", "128", "-o", directory_ / "out.npy"}, "ulimit -f 8;");
  EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("File too large"));
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  EXPECT_EQ(directory_.FileCount(), 1u);
}

TEST_F(CliFiles, AHangupEndsTheJobWithTheReasonAndLeavesNothing) {
  const std::vector<std::string> arguments = {
      "voxelize", box_, "--resolution",        "256", "--target", "f32x4:replace:shader=base_color", "--repeat",
      "100000",   "-o", directory_ / "out.npy"};
  const CliOutcome outcome = RunCli(arguments, "timeout --preserve-status --signal=HUP 1");
  EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("SIGHUP"));
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  EXPECT_EQ(directory_.FileCount(), 1u);
}

TEST_F(CliFiles, WhoeverIgnoresHangupsIsNotEndedByOne) {
  const auto before = std::signal(SIGHUP, SIG_IGN);  // as nohup does; a child inherits it
  CliProcess process({"voxelize", box_, "--resolution", "128", "--repeat", "200"});
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  process.Signal(SIGHUP);
  EXPECT_EQ(process.Wait(), 0);
  std::signal(SIGHUP, before);
}

TEST_F(CliFiles, AnInputThatCannotBeReadSaysWhyAndNamesItsPathOnce) {
  const auto check = [&](const std::string& path, const std::string& why) {
    for (const char* command : {"voxelize", "info"}) {
      EXPECT_EQ(RunCli({command, path}).err, "voxelpipe: " + path + ": " + why + "\n");
    }
  };
  check(directory_ / "none.glb", "no such file");
  if (geteuid() == 0) GTEST_SKIP() << "root reads everything";
  fs::permissions(box_, fs::perms::none);
  check(box_, "cannot be read: Permission denied");
}

TEST_F(CliFiles, AFullOutputSaysWhy) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  fs::create_symlink("/dev/full", directory_ / "full.npy");
  const CliOutcome outcome = Voxelize({"-o", directory_ / "full.npy"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("No space left on device"));
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
}

TEST_F(CliFiles, WhatLiesOutsideIsReadWhereItIsAllowedAndRefusedByNameOtherwise) {
  fs::create_directories(directory_ / "models");
  fs::create_directories(directory_ / "textures");
  // One red pixel; stored, not compressed.
  constexpr uint8_t kPng[] = {137, 80, 78,  71, 13,  10,  26, 10, 0, 0, 0,   13,  73,  72,  68,  82, 0,  0,
                              0,   1,  0,   0,  0,   1,   8,  2,  0, 0, 0,   144, 119, 83,  222, 0,  0,  0,
                              15,  73, 68,  65, 84,  120, 1,  1,  4, 0, 251, 255, 0,   255, 0,   0,  3,  1,
                              1,   0,  141, 29, 229, 130, 0,  0,  0, 0, 73,  69,  78,  68,  174, 66, 96, 130};
  std::ofstream(directory_ / "textures/t.png", std::ios::binary)
      .write(reinterpret_cast<const char*>(kPng), sizeof kPng);
  const float triangle[15] = {0, 0, 0, 1, 0, 0, 0, 1,
                              0, 0, 0, 0, 0, 0, 0};  // three positions, three texture coordinates
  std::ofstream(directory_ / "models/m.bin", std::ios::binary)
      .write(reinterpret_cast<const char*>(triangle), sizeof triangle);
  const auto write = [&](const std::string& name, const std::string& image) {
    const json document = {
        {"asset", {{"version", "2.0"}}},
        {"scene", 0},
        {"scenes", {{{"nodes", {0}}}}},
        {"nodes", {{{"mesh", 0}}}},
        {"meshes", {{{"primitives", {{{"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 1}}}, {"material", 0}}}}}}},
        {"materials", {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}}},
        {"textures", {{{"source", 0}}}},
        {"images", {{{"uri", image}}}},
        {"buffers", {{{"byteLength", 60}, {"uri", "m.bin"}}}},
        {"bufferViews", {{{"buffer", 0}, {"byteLength", 36}}, {{"buffer", 0}, {"byteOffset", 36}, {"byteLength", 24}}}},
        {"accessors",
         {{{"bufferView", 0},
           {"componentType", 5126},
           {"count", 3},
           {"type", "VEC3"},
           {"min", {0, 0, 0}},
           {"max", {1, 1, 0}}},
          {{"bufferView", 1}, {"componentType", 5126}, {"count", 3}, {"type", "VEC2"}}}}};
    std::ofstream(directory_ / name) << document.dump();
  };
  write("models/parent.gltf", "../textures/t.png");
  fs::create_symlink("../textures/t.png", directory_ / "models/t.png");
  write("models/link.gltf", "t.png");
  write("inside.gltf", "textures/t.png");
  fs::copy_file(directory_ / "models/m.bin", directory_ / "m.bin");
  const auto run = [&](const std::string& name, std::vector<std::string> more) {
    more.insert(more.begin(), {"voxelize", directory_ / name, "--resolution", "8", "--target",
                               "u8x4:replace:shader=base_color", "--json"});
    return RunCli(more);
  };
  const CliOutcome inside = run("inside.gltf", {});
  ASSERT_EQ(inside.exit_code, 0) << inside.err;
  for (const char* name : {"models/parent.gltf", "models/link.gltf"}) {
    const CliOutcome refused = run(name, {});
    EXPECT_EQ(refused.exit_code, 1);
    EXPECT_EQ(LineCount(refused.err), 1u) << refused.err;
    EXPECT_THAT(refused.err, HasSubstr((fs::canonical(directory_.path()) / "textures/t.png").string()));
    EXPECT_THAT(refused.err, HasSubstr("--allow-outside"));
    const CliOutcome allowed = run(name, {"--allow-outside"});
    ASSERT_EQ(allowed.exit_code, 0) << allowed.err;
    EXPECT_EQ(ParseJson(allowed.out)["hash"], ParseJson(inside.out)["hash"]) << name;
    // Who wants no colour needs no texture.
    EXPECT_EQ(RunCli({"voxelize", directory_ / name, "--resolution", "8"}).exit_code, 0);
    EXPECT_EQ(RunCli({"info", directory_ / name}).exit_code, 0);
  }
}

}  // namespace
}  // namespace voxelpipe
