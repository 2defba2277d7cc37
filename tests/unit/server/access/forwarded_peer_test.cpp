#include "access/forwarded_peer.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

TEST(ForwardedPeersTest, OnlyThisProcessCanWriteThem) {
  const ForwardedPeers peers, others;
  const std::string value = peers.Write("ipv6:%5B::1%5D:58468");
  EXPECT_EQ(peers.Read(value), "ipv6:%5B::1%5D:58468");
  EXPECT_FALSE(others.Read(value));
  EXPECT_FALSE(peers.Read("ipv4:1.2.3.4:5"));
  EXPECT_FALSE(peers.Read(""));
  EXPECT_FALSE(peers.Read(value.substr(0, 32)));
  EXPECT_FALSE(peers.Read(value.substr(1)));
  std::string changed = value;
  changed[3] = changed[3] == '0' ? '1' : '0';
  EXPECT_FALSE(peers.Read(changed));
}

}  // namespace
}  // namespace voxelpipe
