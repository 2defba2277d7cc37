#include "base/device_failure.h"

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

TEST(DeviceFailureTest, AStatusKeepsItsCodeAndWordsBesideTheMark) {
  for (const auto kind : {DeviceFailureKind::kError, DeviceFailureKind::kLost, DeviceFailureKind::kOutOfMemory}) {
    const absl::Status marked = MarkDeviceFailure(absl::InternalError("it broke"), kind);
    EXPECT_EQ(marked.code(), absl::StatusCode::kInternal);
    EXPECT_EQ(marked.message(), "it broke");
    EXPECT_EQ(DeviceFailureOf(marked), kind);
  }
}

TEST(DeviceFailureTest, WithoutAMarkItIsNotTheDevice) {
  EXPECT_FALSE(DeviceFailureOf(absl::OkStatus()).has_value());
  EXPECT_FALSE(DeviceFailureOf(absl::ResourceExhaustedError("the request is too large")).has_value());
}

TEST(DeviceFailureTest, TheLaterMarkCounts) {
  const absl::Status error = MarkDeviceFailure(absl::InternalError("it broke"), DeviceFailureKind::kError);
  EXPECT_EQ(DeviceFailureOf(MarkDeviceFailure(error, DeviceFailureKind::kLost)), DeviceFailureKind::kLost);
}

}  // namespace
}  // namespace voxelpipe
