#include "address.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

// The same cases as in client/python/tests/test_foreign_meshes.py.
TEST(AddressTest, ThoseThatNoServerHasAreRefused) {
  for (const auto& [address, why] : {std::pair{"localhost", "has no port"},
                                     {"http://localhost:50051", "is a URL"},
                                     {"localhost:", "has the port ''"},
                                     {"localhost:port", "has the port 'port'"},
                                     {"localhost:0", "has the port '0'"},
                                     {"localhost:65536", "has the port '65536'"},
                                     {":50051", "has no host"},
                                     {"::1", "has more than one colon"},
                                     {"[::1]", "has no port"},
                                     {"dns:///localhost", "has no port"},
                                     {"", "has no port"}}) {
    const absl::Status status = CheckAddress(address);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << address;
    EXPECT_THAT(std::string(status.message()), HasSubstr(why)) << address;
  }
}

TEST(AddressTest, ThoseOfGrpcAreTaken) {
  for (const char* address :
       {"localhost:1", "[::1]:50051", "unix:/tmp/a", "unix:///tmp/a", "dns:///a:443", "dns:a:443", "ipv4:1.2.3.4:5"}) {
    EXPECT_TRUE(CheckAddress(address).ok()) << address;
  }
}

}  // namespace
}  // namespace voxelpipe
