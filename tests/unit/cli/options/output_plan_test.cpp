#include "options/output_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "unit/encode/sample_results.h"

namespace voxelpipe::cli {
namespace {

using ::testing::HasSubstr;

// Files named by the stems of their paths.
InputList Files(const std::vector<std::string>& paths) {
  InputList list;
  for (const std::string& path : paths) list.files.push_back({path, std::filesystem::path(path).stem().string()});
  return list;
}

TEST(PlanOutputs, WithoutOptionsNothingIsWritten) {
  const std::vector<OutputPlan> plans = PlanOutputs(Files({"a.glb", "b.glb"}), {}).value();
  ASSERT_EQ(plans.size(), 2u);
  for (const OutputPlan& plan : plans) {
    EXPECT_EQ(plan.result, "");
    EXPECT_EQ(plan.preview, "");
  }
}

TEST(PlanOutputs, OneInputTakesTheNamesAsTheyAre) {
  const std::vector<OutputPlan> plans = PlanOutputs(Files({"a.glb"}), {"dir/out.raw", "look.PNG", ""}).value();
  EXPECT_EQ(plans[0].result, "dir/out.raw");
  EXPECT_EQ(plans[0].preview, "look.PNG");
}

TEST(PlanOutputs, SeveralInputsGoIntoADirectoryUnderTheirStems) {
  const std::vector<OutputPlan> plans = PlanOutputs(Files({"x/a.glb", "y/b.c.gltf"}), {"out", "pictures", ""}).value();
  EXPECT_EQ(plans[0].result, "out/a.npy");
  EXPECT_EQ(plans[1].result, "out/b.c.npy");
  EXPECT_EQ(plans[0].preview, "pictures/a.png");
  EXPECT_EQ(plans[1].preview, "pictures/b.c.png");
}

TEST(PlanOutputs, TwoInputsWithOneNameAreRefused) {
  const auto error = [](const InputList& inputs, const OutputNames& names) {
    return std::string(PlanOutputs(inputs, names).status().message());
  };
  EXPECT_THAT(error(Files({"x/a.glb", "y/a.gltf"}), {"out", "", ""}),
              HasSubstr("'x/a.glb' and 'y/a.gltf' would both become 'out/a.npy'; run them apart"));
  EXPECT_THAT(error(Files({"a.glb", "a.glb"}), {"", "pictures", ""}), HasSubstr("would both become"));
  EXPECT_THAT(error(Files({"a.glb"}), {"a.png", "a.png", ""}), HasSubstr("--preview: 'a.png' is the file of --output"));
  EXPECT_TRUE(PlanOutputs(Files({"a.glb", "a.glb"}), {}).ok());  // nothing is written
}

TEST(PlanOutputs, AnOpenEndedListNeedsADirectoryHoweverManyFilesItHas) {
  InputList one = Files({"m/a.glb"});
  one.files[0].name = "sub/a";
  one.open_ended = true;
  EXPECT_EQ(PlanOutputs(one, {"out", "", "raw"}).value()[0].result, "out/sub/a.raw");
  EXPECT_THAT(std::string(PlanOutputs(one, {"out.npy", "", ""}).status().message()),
              HasSubstr("a directory or pattern"));
  EXPECT_THAT(std::string(PlanOutputs(one, {"-", "", "npy"}).status().message()), HasSubstr("not of a list"));
}

TEST(PlanOutputs, RefusesTheMeshItself) {
  const testing::TemporaryDirectory directory;
  std::ofstream(directory / "a.npy") << "a mesh, whatever its name";
  std::filesystem::create_symlink("a.npy", directory / "b.npy");
  for (const char* name : {"a.npy", "b.npy"}) {
    EXPECT_THAT(std::string(PlanOutputs(Files({directory / "a.npy"}), {directory / name, "", ""}).status().message()),
                HasSubstr("is the mesh itself"));
  }
  EXPECT_TRUE(PlanOutputs(Files({directory / "a.npy"}), {directory / "c.npy", "", ""}).ok());
}

TEST(PlanOutputs, ADirectoryServesOneInputToo) {
  const testing::TemporaryDirectory directory;
  EXPECT_EQ(PlanOutputs(Files({"a.glb"}), {directory.path().string(), "", ""}).value()[0].result, directory / "a.npy");
  EXPECT_EQ(PlanOutputs(Files({"a.glb"}), {"new/", "", ""}).value()[0].result, "new/a.npy");
}

TEST(PlanOutputs, RefusesNamesThatCannotHoldTheResult) {
  const auto error = [](const std::vector<std::string>& inputs, const std::string& output, const std::string& preview) {
    const auto plans = PlanOutputs(Files(inputs), {output, preview, ""});
    EXPECT_EQ(plans.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(plans.status().message());
  };
  EXPECT_THAT(error({"a.glb"}, "out.xyz", ""), HasSubstr("out.xyz"));
  EXPECT_THAT(error({"a.glb"}, "out", ""), HasSubstr("none"));
  EXPECT_THAT(error({"a.glb"}, "", "out.npy"), HasSubstr("--preview"));
  EXPECT_THAT(error({"a.glb", "b.glb"}, "out.npy", ""), HasSubstr("directory"));
  EXPECT_THAT(error({"a.glb", "b.glb"}, "", "out.png"), HasSubstr("directory"));
}

}  // namespace
}  // namespace voxelpipe::cli
