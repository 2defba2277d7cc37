#include "base/nearest_name.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

const std::vector<std::string> kNames = {"normal", "geometric_normal", "base_color", "uv"};

TEST(NearestNameTest, FindsWhatWasMeant) {
  EXPECT_EQ(DidYouMean("normals", kNames), "did you mean 'normal'?");
  EXPECT_EQ(DidYouMean("nromal", kNames), "did you mean 'normal'?");
  EXPECT_EQ(DidYouMean("Normal", kNames), "did you mean 'normal'?");
  EXPECT_EQ(DidYouMean("base_colour", kNames), "did you mean 'base_color'?");
  EXPECT_EQ(DidYouMean("geometric_nromals", kNames), "did you mean 'geometric_normal'?");
  EXPECT_EQ(DidYouMean("u", kNames), "did you mean 'uv'?");
}

TEST(NearestNameTest, GpuMeansCudaWhereThatIsAChoice) {
  EXPECT_EQ(NearestName("gpu", {"auto", "cpu", "cuda"}), "cuda");
  EXPECT_EQ(NearestName("GPU", {"auto", "cpu", "cuda"}), "cuda");
  EXPECT_EQ(NearestName("gpu", {"cpu"}), "cpu");
}

TEST(NearestNameTest, AnUnknownChoiceNamesTheNearestAndAll) {
  EXPECT_EQ(UnknownChoice("partiy", {"none", "parity"}),
            "unknown choice 'partiy'; did you mean 'parity'? known are none, parity");
  EXPECT_EQ(UnknownChoice("x", {"none", "parity"}), "unknown choice 'x'; known are none, parity");
}

TEST(NearestNameTest, SaysNothingWhereNothingIsNear) {
  EXPECT_EQ(DidYouMean("phong", kNames), "");
  EXPECT_EQ(DidYouMean("none.glb", {"box.glb"}), "");
  EXPECT_EQ(DidYouMean("", kNames), "");
  EXPECT_EQ(DidYouMean("xyz", kNames), "");
  EXPECT_EQ(DidYouMean(std::string(1000, 'u'), kNames), "");
  EXPECT_EQ(DidYouMean("normal", {}), "");
  EXPECT_EQ(DidYouMean("normal", {std::string(1000, 'n')}), "");
}

}  // namespace
}  // namespace voxelpipe
