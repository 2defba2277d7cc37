#include "access/certificate_name.h"

#include <string>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

TEST(CertificateNameTest, TheFirstAlternativeNameIsBeforeTheCommonName) {
  EXPECT_EQ(ClientNameOf({{"farm.test", "10.0.0.7"}, "Farm"}), "farm.test");
  EXPECT_EQ(ClientNameOf({{"spiffe://cluster/ns/render"}, "Farm"}), "spiffe://cluster/ns/render");
  EXPECT_EQ(ClientNameOf({{}, "farm"}), "farm");
  EXPECT_EQ(ClientNameOf({{}, ""}), "");
}

TEST(CertificateNameTest, WhatCouldForgeALineOfTheLogNamesNobody) {
  EXPECT_EQ(ClientNameOf({{"a b", "line\nfeed", "quote\"", std::string(129, 'a')}, "farm"}), "farm");
  EXPECT_EQ(ClientNameOf({{"*.farm.test"}, ""}), "") << "a wildcard is nobody in particular";
}

TEST(HostOfPeerTest, TheConnectionsOfAMachineAreOneClient) {
  EXPECT_EQ(HostOfPeer("ipv4:10.1.2.3:4567"), "ipv4:10.1.2.3");
  EXPECT_EQ(HostOfPeer("ipv6:%5B::1%5D:4567"), "ipv6:%5B::1%5D");
  EXPECT_EQ(HostOfPeer("unix:/run/voxelpiped"), "unix:/run/voxelpiped");
}

}  // namespace
}  // namespace voxelpipe
