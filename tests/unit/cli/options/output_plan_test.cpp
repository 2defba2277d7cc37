#include "options/output_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "unit/encode/sample_results.h"

namespace voxelpipe::cli {
namespace {

using ::testing::HasSubstr;

TEST(PlanOutputs, WithoutOptionsNothingIsWritten) {
  const std::vector<OutputPlan> plans = PlanOutputs({"a.glb", "b.glb"}, {}).value();
  ASSERT_EQ(plans.size(), 2u);
  for (const OutputPlan& plan : plans) {
    EXPECT_EQ(plan.result, "");
    EXPECT_EQ(plan.preview, "");
  }
}

TEST(PlanOutputs, OneInputTakesTheNamesAsTheyAre) {
  const std::vector<OutputPlan> plans = PlanOutputs({"a.glb"}, {"dir/out.raw", "look.PNG", ""}).value();
  EXPECT_EQ(plans[0].result, "dir/out.raw");
  EXPECT_EQ(plans[0].preview, "look.PNG");
}

TEST(PlanOutputs, SeveralInputsGoIntoADirectoryUnderTheirStems) {
  const std::vector<OutputPlan> plans = PlanOutputs({"x/a.glb", "y/b.c.gltf"}, {"out", "pictures", ""}).value();
  EXPECT_EQ(plans[0].result, "out/a.npy");
  EXPECT_EQ(plans[1].result, "out/b.c.npy");
  EXPECT_EQ(plans[0].preview, "pictures/a.png");
  EXPECT_EQ(plans[1].preview, "pictures/b.c.png");
}

TEST(PlanOutputs, TellsApartInputsOfTheSameStem) {
  const std::vector<OutputPlan> plans =
      PlanOutputs({"x/a.glb", "y/a.gltf", "a-2.glb", "a.drc"}, {"out", "", ""}).value();
  EXPECT_EQ(plans[0].result, "out/a.npy");
  EXPECT_EQ(plans[1].result, "out/a-2.npy");
  EXPECT_EQ(plans[2].result, "out/a-2-2.npy");
  EXPECT_EQ(plans[3].result, "out/a-3.npy");
}

TEST(PlanOutputs, ADirectoryServesOneInputToo) {
  const testing::TemporaryDirectory directory;
  EXPECT_EQ(PlanOutputs({"a.glb"}, {directory.path().string(), "", ""}).value()[0].result, directory / "a.npy");
  EXPECT_EQ(PlanOutputs({"a.glb"}, {"new/", "", ""}).value()[0].result, "new/a.npy");
}

TEST(PlanOutputs, RefusesNamesThatCannotHoldTheResult) {
  const auto error = [](const std::vector<std::string>& inputs, const std::string& output, const std::string& preview) {
    const auto plans = PlanOutputs(inputs, {output, preview, ""});
    EXPECT_EQ(plans.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(plans.status().message());
  };
  EXPECT_THAT(error({"a.glb"}, "out.vti", ""), HasSubstr("out.vti"));
  EXPECT_THAT(error({"a.glb"}, "out", ""), HasSubstr("none"));
  EXPECT_THAT(error({"a.glb"}, "", "out.npy"), HasSubstr("--preview"));
  EXPECT_THAT(error({"a.glb", "b.glb"}, "out.npy", ""), HasSubstr("directory"));
  EXPECT_THAT(error({"a.glb", "b.glb"}, "", "out.png"), HasSubstr("directory"));
}

}  // namespace
}  // namespace voxelpipe::cli
