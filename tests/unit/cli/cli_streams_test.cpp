// "-": meshes from standard input, results to standard output.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "cli_runner.h"
#include "support/json/json.h"
#include "terminal.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::CliOutcome;
using ::testing::HasSubstr;
using testing::LineCount;
using testing::ParseJson;
using testing::ReadFile;
using testing::RunCli;
using testing::ShellQuoted;
using testing::TemporaryDirectory;
using testing::Terminal;
using testing::WriteBoxGlb;

class CliStreams : public ::testing::Test {
 protected:
  CliStreams() : box_(directory_ / "box.glb"), from_box_("<" + ShellQuoted(box_)) { WriteBoxGlb(box_, 1, 2, 4); }

  CliOutcome Voxelize(std::vector<std::string> arguments, const std::string& redirections = "") {
    arguments.insert(arguments.begin(), {"voxelize", "--resolution", "16"});
    return RunCli(arguments, "", redirections);
  }
  std::string Written(const std::string& name) {
    const std::vector<uint8_t> bytes = ReadFile(directory_ / name);
    return {bytes.begin(), bytes.end()};
  }
  void ExpectRefused(const std::vector<std::string>& arguments, const std::string& why,
                     const std::string& redirections = "") {
    const CliOutcome outcome = Voxelize(arguments, redirections);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(why));
    EXPECT_EQ(outcome.out, "");
  }

  TemporaryDirectory directory_;
  std::string box_, from_box_;
};

TEST_F(CliStreams, AMeshFromStandardInputGivesTheBytesOfItsFile) {
  ASSERT_EQ(Voxelize({box_, "-o", directory_ / "file.npy"}).exit_code, 0);
  const CliOutcome read = Voxelize({"-", "-o", directory_ / "stream.npy", "--json"}, from_box_);
  ASSERT_EQ(read.exit_code, 0) << read.err;
  EXPECT_EQ(ParseJson(read.out)["input"], "-");
  EXPECT_EQ(Written("stream.npy"), Written("file.npy"));
}

TEST_F(CliStreams, AMeshThatComesThroughAPipeInPiecesIsRead) {
  const std::string pipe = ShellQuoted(directory_ / "pipe");
  const std::string writer =
      "mkfifo " + pipe + "; ( (head -c 100; sleep 0.2; cat) <" + ShellQuoted(box_) + " >" + pipe + " 2>/dev/null & ) ;";
  const CliOutcome outcome = RunCli({"voxelize", "-", "--resolution", "16", "--json"}, writer, "<" + pipe);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(ParseJson(outcome.out)["triangles"], 12);
}

TEST_F(CliStreams, AnEmptyStandardInputFailsTheJobByName) {
  const CliOutcome outcome = Voxelize({"-"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("standard input: "));
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
}

TEST_F(CliStreams, InfoReadsStandardInputToo) {
  const CliOutcome outcome = RunCli({"info", "-", "--json"}, "", from_box_);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(ParseJson(outcome.out)["triangles"], 12);
  const std::string next = ParseJson(outcome.out)["health"]["next"];
  EXPECT_THAT(next, ::testing::EndsWith("-o voxels.npy")) << "there is no name to take";
}

TEST_F(CliStreams, SiblingsOfAGltfOnStandardInputAreThoseOfTheWorkingDirectory) {
  const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  std::ofstream(directory_ / "tri.bin", std::ios::binary)
      .write(reinterpret_cast<const char*>(positions), sizeof positions);
  std::ofstream(directory_ / "tri.gltf")
      << R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
      << R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],)"
      << R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],)"
      << R"("bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"tri.bin"}]})";
  const std::string here = "cd " + ShellQuoted(directory_.path().string()) + " &&";
  const CliOutcome outcome = RunCli({"info", "-", "--json"}, here, "<tri.gltf");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(ParseJson(outcome.out)["triangles"], 1);
}

TEST_F(CliStreams, EveryFormatOnStandardOutputIsItsFile) {
  for (const std::string format : {"npy", "npz", "raw", "png"}) {
    const std::string file = "out." + format;
    ASSERT_EQ(Voxelize({box_, "-o", directory_ / file}).exit_code, 0);
    const CliOutcome streamed = Voxelize({box_, "-o", "-", "--format", format, "--json"});
    ASSERT_EQ(streamed.exit_code, 0) << streamed.err;
    EXPECT_EQ(streamed.out, Written(file)) << format;
    const json summary = ParseJson(streamed.err);  // and nothing else
    EXPECT_EQ(summary["files"], json({"-"}));
    EXPECT_EQ(summary["triangles"], 12);
  }
}

TEST_F(CliStreams, BytesAreAppendedToAFileThatStandardOutputAppendsTo) {
  std::ofstream(directory_ / "log") << "before";
  const CliOutcome outcome = Voxelize({box_, "-o", "-", "--format", "raw"}, ">>" + ShellQuoted(directory_ / "log"));
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  ASSERT_EQ(Voxelize({box_, "-o", directory_ / "out.raw"}).exit_code, 0);
  EXPECT_EQ(Written("log"), "before" + Written("out.raw"));
}

TEST_F(CliStreams, SeveralTargetsGoThroughAsOneNpz) {
  const std::vector<std::string> targets = {"--target", "bit:or", "--target", "u16:count"};
  std::vector<std::string> arguments = {box_, "-o", directory_ / "out.npz"};
  arguments.insert(arguments.end(), targets.begin(), targets.end());
  ASSERT_EQ(Voxelize(arguments).exit_code, 0);
  arguments[2] = "-";
  arguments.insert(arguments.end(), {"--format", "npz"});
  EXPECT_EQ(Voxelize(arguments).out, Written("out.npz"));
  arguments.back() = "npy";
  ExpectRefused(arguments, "give --format npz or a file name");
  arguments.back() = "raw";
  ExpectRefused(arguments, "2 targets are 2 .raw files");
}

TEST_F(CliStreams, AClosedPipeFailsTheJob) {
  const std::string pipe = ShellQuoted(directory_ / "pipe");
  const CliOutcome outcome = RunCli({"voxelize", box_, "--resolution", "128", "-o", "-", "--format", "npy"},
                                    "mkfifo " + pipe + "; ( true <" + pipe + " & ) ;", ">" + pipe);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("standard output"));
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
}

TEST_F(CliStreams, WhatStreamsCannotDoExitsWith2AndNamesTheNextStep) {
  ExpectRefused({box_, "-o", "-"}, "name its format by --format npy, npz, raw");
  ExpectRefused({box_, "-o", "-", "--format", "xyz"}, "xyz");
  ExpectRefused({box_, "-o", "-", "--format", ""}, "--format");
  ExpectRefused({box_, "--format", "npy"}, "--output, which is not given");
  ExpectRefused({box_, "-o", directory_ / "out.npy", "--format", "raw"}, "leave --format out");
  ExpectRefused({box_, box_, "-o", "-", "--format", "npy"}, "not of a list; give a directory");
  ExpectRefused({box_, "--result", "sparse", "-o", "-", "--format", "npy"}, "npz");
  ExpectRefused({"-", "-"}, "give it once", from_box_);
  EXPECT_EQ(directory_.FileCount(), 1u);
}

TEST_F(CliStreams, ATerminalIsNoPlaceForAMeshOrAResult) {
  const Terminal terminal;
  if (terminal.path().empty()) GTEST_SKIP() << "this system has no pseudo-terminals";
  ExpectRefused({"-"}, "redirect it: '- < mesh.glb'", "<" + terminal.path());
  EXPECT_EQ(RunCli({"info", "-"}, "", "<" + terminal.path()).exit_code, 2);
  ExpectRefused({box_, "-o", "-", "--format", "npy"}, "redirect it: '-o - > out.npy'", ">" + terminal.path());
}

TEST_F(CliStreams, ADirectoryTakesTheFormatOfItsFiles) {
  const CliOutcome outcome = Voxelize({"-", "-o", (directory_.path() / "out/").string(), "--format", "npz"}, from_box_);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_TRUE(std::filesystem::exists(directory_ / "out/stdin.npz"));
}

}  // namespace
}  // namespace voxelpipe
