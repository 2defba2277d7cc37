#include "base/warning.h"

#include <gtest/gtest.h>

#include <string>

namespace voxelpipe {
namespace {

TEST(WarningListTest, KeepsAHundredAndCountsTheRest) {
  WarningList list;
  for (int i = 0; i < 130; ++i) list.Add(WarningCode::kTextureMissing, "image " + std::to_string(i), "no bytes");
  EXPECT_EQ(list.kept().size(), 100u);
  EXPECT_EQ(list.left_out(), 30u);
  WarningList all;
  all.Add(WarningCode::kNoScene, "", "no scenes");
  all.Append(list);
  EXPECT_EQ(all.kept().size(), 100u);
  EXPECT_EQ(all.left_out(), 31u);
}

TEST(WarningListTest, DropsWhatItHasAlready) {
  WarningList list;
  for (int i = 0; i < 3; ++i) list.Add(WarningCode::kNoScene, "", "no scenes");
  EXPECT_EQ(list.kept().size(), 1u);
  EXPECT_EQ(list.left_out(), 0u);
}

TEST(WarningListTest, CutsLongTextsBetweenCharacters) {
  WarningList list;
  std::string text = "a";
  for (int i = 0; i < 1000; ++i) text += "\xC3\xBC";
  list.Add(WarningCode::kNonconformingFile, "node 1", text);
  const std::string& kept = list.kept()[0].text;
  EXPECT_LE(kept.size(), WarningList::kMaxTextBytes);
  EXPECT_TRUE(kept.ends_with("\xC3\xBC...")) << kept;
}

TEST(WarningTest, ALineIsPlaceAndText) {
  EXPECT_EQ((Warning{WarningCode::kNoScene, "", "no scenes"}.Line()), "no scenes");
  EXPECT_EQ((Warning{WarningCode::kTextureMissing, "image 2", "no bytes"}.Line()), "image 2: no bytes");
}

}  // namespace
}  // namespace voxelpipe
