#include "web/http/client_network.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

ClientNetwork Of4(const char* text, uint16_t port = 1) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  EXPECT_EQ(inet_pton(AF_INET, text, &address.sin_addr), 1);
  return NetworkOf(reinterpret_cast<const sockaddr*>(&address));
}

ClientNetwork Of6(const char* text, uint16_t port = 1) {
  sockaddr_in6 address{};
  address.sin6_family = AF_INET6;
  address.sin6_port = htons(port);
  EXPECT_EQ(inet_pton(AF_INET6, text, &address.sin6_addr), 1);
  return NetworkOf(reinterpret_cast<const sockaddr*>(&address));
}

TEST(ClientNetworkTest, AnAddressOfIpv4IsAClient) {
  EXPECT_EQ(Of4("192.0.2.7", 1), Of4("192.0.2.7", 2));
  EXPECT_NE(Of4("192.0.2.7"), Of4("192.0.2.8"));
  EXPECT_EQ(Of4("192.0.2.7"), Of6("::ffff:192.0.2.7")) << "as a socket of both kinds sees it";
  EXPECT_NE(Of6("::ffff:192.0.2.7"), Of6("::ffff:192.0.2.8"));
}

TEST(ClientNetworkTest, ANetworkOfIpv6IsAClient) {
  EXPECT_EQ(Of6("2001:db8:1:2::1", 1), Of6("2001:db8:1:2:ffff::9", 2));
  EXPECT_NE(Of6("2001:db8:1:2::1"), Of6("2001:db8:1:3::1"));
  EXPECT_NE(Of6("2001:db8:1:2::1"), Of4("192.0.2.7"));
}

}  // namespace
}  // namespace voxelpipe
