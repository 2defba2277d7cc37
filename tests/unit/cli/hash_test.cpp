#include "hash.h"

#include <gtest/gtest.h>

#include <cstring>

namespace voxelpipe::cli {
namespace {

HostBuffer Bytes(const std::string& text) {
  HostBuffer buffer = HostBuffer::Allocate(text.size()).value();
  std::memcpy(buffer.data(), text.data(), text.size());
  return buffer;
}

TEST(HashResult, IsTheSha256OfAllTargetsInOrder) {
  VoxelizeResult result;
  EXPECT_EQ(HashResult(result).value(), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  result.targets.push_back(Bytes("abc"));
  // FIPS 180-2, appendix B.1.
  EXPECT_EQ(HashResult(result).value(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  VoxelizeResult split;
  split.targets.push_back(Bytes("a"));
  split.targets.push_back(Bytes("bc"));
  EXPECT_EQ(HashResult(split).value(), HashResult(result).value());
}

}  // namespace
}  // namespace voxelpipe::cli
