#include "grid/voxel_format.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

TEST(VoxelFormatTest, NamesRoundTrip) {
  for (const VoxelFormat f : {VoxelFormat::kBit, VoxelFormat::kF32}) EXPECT_EQ(ParseVoxelFormat(Name(f)), f);
  for (const Blend b : {Blend::kOr, Blend::kReplace, Blend::kMin, Blend::kMax, Blend::kAdd}) {
    EXPECT_EQ(ParseBlend(Name(b)), b);
  }
  EXPECT_FALSE(ParseBlend("xor").has_value());
  EXPECT_FALSE(ParseVoxelFormat("F32").has_value());
}

TEST(VoxelFormatTest, BlendsThatAreDefined) {
  EXPECT_TRUE(CheckBlend(VoxelFormat::kBit, Blend::kOr).ok());
  EXPECT_TRUE(CheckBlend(VoxelFormat::kBit, Blend::kReplace).ok());
  EXPECT_FALSE(CheckBlend(VoxelFormat::kBit, Blend::kAdd).ok());
  EXPECT_FALSE(CheckBlend(VoxelFormat::kF32, Blend::kOr).ok());
  for (const Blend b : {Blend::kReplace, Blend::kMin, Blend::kMax, Blend::kAdd}) {
    EXPECT_TRUE(CheckBlend(VoxelFormat::kF32, b).ok());
  }
}

}  // namespace
}  // namespace voxelpipe
