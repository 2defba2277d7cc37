#include "wire/status.h"

#include <string>

#include "base/limit_error.h"
#include "base/text.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

// The one detail of a status, which must be of type T.
template <typename T>
T Detail(const grpc::Status& status) {
  google::rpc::Status details;
  EXPECT_TRUE(details.ParseFromString(status.error_details()));
  EXPECT_EQ(details.code(), int(status.error_code()));
  EXPECT_EQ(details.message(), status.error_message());
  T detail;
  EXPECT_TRUE(details.details_size() == 1 && details.details(0).UnpackTo(&detail)) << details.DebugString();
  return detail;
}

TEST(StatusTest, EveryCodeKeepsItsNumberAndMessageBothWays) {
  for (int code = 1; code <= 16; ++code) {
    const absl::Status status(absl::StatusCode(code), "grid.padding: must not be negative");
    const grpc::Status sent = ToGrpcStatus(status);
    EXPECT_EQ(int(sent.error_code()), code);
    EXPECT_EQ(FromGrpcStatus(sent), status);
  }
  EXPECT_TRUE(ToGrpcStatus(absl::OkStatus()).ok());
  EXPECT_TRUE(FromGrpcStatus(grpc::Status::OK).ok());
}

TEST(StatusTest, AnInvalidArgumentNamesTheField) {
  const auto bad = Detail<google::rpc::BadRequest>(
      ToGrpcStatus(absl::InvalidArgumentError("targets[1].blend: blend 'or': not for f32")));
  ASSERT_EQ(bad.field_violations_size(), 1);
  EXPECT_EQ(bad.field_violations(0).field(), "targets[1].blend");
  EXPECT_EQ(bad.field_violations(0).description(), "blend 'or': not for f32");
}

TEST(StatusTest, AFieldThatTheMessageDoesNotNameLeavesTheMessageAsItIs) {
  const grpc::Status sent =
      ToGrpcStatus(WithField(absl::InvalidArgumentError("no mesh: neither this nor that"), "mesh"));
  EXPECT_EQ(sent.error_message(), "no mesh: neither this nor that");
  const auto bad = Detail<google::rpc::BadRequest>(sent);
  EXPECT_EQ(bad.field_violations(0).field(), "mesh");
  EXPECT_EQ(bad.field_violations(0).description(), "no mesh: neither this nor that");
}

TEST(StatusTest, TheTextOfAnErrorIsWhatTheWireCarries) {
  for (const std::string& text : {std::string("plain"), std::string(1 << 20, 'n'), std::string("a\nb\x01\xff c")}) {
    const absl::Status status = absl::InternalError(text);
    EXPECT_EQ(ErrorText(status), ToGrpcStatus(status).error_message());
    EXPECT_LE(ErrorText(status).size(), 1000u);
    EXPECT_EQ(ErrorText(absl::InternalError(ErrorText(status))), ErrorText(status)) << "once is enough";
  }
}

TEST(StatusTest, AnInvalidArgumentNamesThePartOfTheMesh) {
  const auto field = [](const char* message) {
    const auto bad = Detail<google::rpc::BadRequest>(ToGrpcStatus(absl::InvalidArgumentError(message)));
    return bad.field_violations(0).field() + " | " + bad.field_violations(0).description();
  };
  EXPECT_EQ(field("glTF: mesh 0, primitive 1: accessor 2: index 9"), "glTF: mesh 0, primitive 1 | accessor 2: index 9");
  EXPECT_EQ(field("GLB: byte 8: the length"), "GLB: byte 8 | the length");
  EXPECT_EQ(field("glTF: node 0 is part of a cycle"), "glTF | node 0 is part of a cycle");
  EXPECT_EQ(field("glTF: the name 'a: b' is wrong"), "glTF | the name 'a: b' is wrong");
}

TEST(StatusTest, AnInvalidArgumentWithoutAFieldKeepsItsWholeText) {
  const auto bad = Detail<google::rpc::BadRequest>(ToGrpcStatus(absl::InvalidArgumentError("not a mesh")));
  ASSERT_EQ(bad.field_violations_size(), 1);
  EXPECT_EQ(bad.field_violations(0).field(), "");
  EXPECT_EQ(bad.field_violations(0).description(), "not a mesh");
}

TEST(StatusTest, AMissingBackendIsNotAvailable) {
  const grpc::Status sent = ToGrpcStatus(absl::FailedPreconditionError("backend: this server has no cuda worker"));
  EXPECT_EQ(Detail<google::rpc::ErrorInfo>(sent).reason(), "NOT_AVAILABLE");
}

TEST(StatusTest, ALimitCarriesNeedAndLimitAndNoRetry) {
  const std::string message =
      "grid 9x9x9 needs 99 bytes of results, the limit is 9; the largest resolution that fits is 4";
  const grpc::Status sent = ToGrpcStatus(absl::ResourceExhaustedError(message));
  const auto info = Detail<google::rpc::ErrorInfo>(sent);
  EXPECT_EQ(info.reason(), "LIMIT_EXCEEDED");
  EXPECT_EQ(info.metadata().at("need_and_limit"), message);
  EXPECT_FALSE(RetryDelay(FromGrpcStatus(sent)).has_value());
}

TEST(StatusTest, ALimitsNumbersAreFieldsOnBothSides) {
  const grpc::Status sent = ToGrpcStatus(MakeLimitError("too large", {uint64_t{1} << 63, 9, 4}));
  const auto info = Detail<google::rpc::ErrorInfo>(sent);
  EXPECT_EQ(info.metadata().at("need_bytes"), "9223372036854775808");
  EXPECT_EQ(info.metadata().at("limit_bytes"), "9");
  EXPECT_EQ(info.metadata().at("largest_resolution"), "4");
  const absl::Status received = FromGrpcStatus(sent);
  EXPECT_EQ(received.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(std::string(received.message()), "too large");
  const auto numbers = LimitErrorOf(received);
  ASSERT_TRUE(numbers.has_value());
  EXPECT_EQ(numbers->need_bytes, uint64_t{1} << 63);
  EXPECT_EQ(numbers->limit_bytes, 9u);
  EXPECT_EQ(numbers->largest_resolution, 4);
  EXPECT_FALSE(info.metadata().contains("smallest_voxel_size"));
  // What does not apply, or cannot be counted, is not there.
  LimitError voxels;
  voxels.limit_bytes = 7;
  voxels.smallest_voxel_size = {0.25, 1.0 / 3, 1e-200};
  const grpc::Status in_voxels = ToGrpcStatus(MakeLimitError("too fine", voxels));
  const auto of_voxels = Detail<google::rpc::ErrorInfo>(in_voxels);
  EXPECT_FALSE(of_voxels.metadata().contains("need_bytes"));
  EXPECT_FALSE(of_voxels.metadata().contains("largest_resolution"));
  const auto voxels_back = LimitErrorOf(FromGrpcStatus(in_voxels));
  ASSERT_TRUE(voxels_back.has_value());
  EXPECT_EQ(voxels_back->limit_bytes, 7u);
  EXPECT_EQ(voxels_back->smallest_voxel_size.y, 1.0 / 3);
  EXPECT_EQ(voxels_back->smallest_voxel_size.x, 0.25);
  EXPECT_EQ(voxels_back->smallest_voxel_size.z, 1e-200);
  EXPECT_FALSE(LimitErrorOf(FromGrpcStatus(ToGrpcStatus(absl::ResourceExhaustedError("other")))).has_value());
}

TEST(StatusTest, LoadCarriesTheDelayAcrossTheWire) {
  const absl::Status busy = BusyError("the queue is full", std::chrono::milliseconds(1250));
  EXPECT_EQ(RetryDelay(busy), std::chrono::milliseconds(1250));
  const grpc::Status sent = ToGrpcStatus(busy);
  const auto retry = Detail<google::rpc::RetryInfo>(sent);
  EXPECT_EQ(retry.retry_delay().seconds(), 1);
  EXPECT_EQ(retry.retry_delay().nanos(), 250'000'000);
  EXPECT_EQ(RetryDelay(FromGrpcStatus(sent)), std::chrono::milliseconds(1250));
}

TEST(StatusTest, AMissingMeshIsNamedOnBothSides) {
  const std::string id(64, 'a');
  EXPECT_EQ(MissingMesh(MissingMeshError(id)), id);
  const grpc::Status sent = ToGrpcStatus(MissingMeshError(id));
  EXPECT_EQ(sent.error_code(), grpc::StatusCode::NOT_FOUND);
  const auto missing = Detail<google::rpc::ResourceInfo>(sent);
  EXPECT_EQ(missing.resource_type(), "voxelpipe.v1.StoredMesh");
  EXPECT_EQ(missing.resource_name(), id);
  EXPECT_EQ(missing.description(), sent.error_message());
  EXPECT_EQ(MissingMesh(FromGrpcStatus(sent)), id);
  EXPECT_FALSE(MissingMesh(FromGrpcStatus(ToGrpcStatus(absl::NotFoundError("something else")))).has_value());
}

TEST(StatusTest, StrangersBytesInAMessageBecomeValidText) {
  const grpc::Status sent = ToGrpcStatus(absl::InvalidArgumentError("node '\xff\n': broken"));
  EXPECT_EQ(sent.error_message(), "node '\?\?': broken");
  EXPECT_EQ(Detail<google::rpc::BadRequest>(sent).field_violations(0).description(), "broken");
}

TEST(StatusTest, ALongMessageFitsIntoTrailers) {
  const grpc::Status sent = ToGrpcStatus(absl::InvalidArgumentError(std::string(100'000, 'x')));
  EXPECT_LE(sent.error_message().size() + sent.error_details().size(), 4096u);
}

TEST(StatusTest, ADelayThatCannotBeIsBetweenNoneAndAnHour) {
  const auto received = [](int64_t seconds, int32_t nanos) {
    google::rpc::RetryInfo retry;
    retry.mutable_retry_delay()->set_seconds(seconds);
    retry.mutable_retry_delay()->set_nanos(nanos);
    google::rpc::Status details;
    details.add_details()->PackFrom(retry);
    const grpc::Status sent(grpc::StatusCode::UNAVAILABLE, "away", details.SerializeAsString());
    return RetryDelay(FromGrpcStatus(sent)).value_or(std::chrono::milliseconds(-1)).count();
  };
  EXPECT_EQ(received(1, 250'000'000), 1250);
  EXPECT_EQ(received(-5, 0), 0);
  EXPECT_EQ(received(0, -1'000'000), 0);
  EXPECT_EQ(received(INT64_MIN, INT32_MIN), 0);
  EXPECT_EQ(received(INT64_MAX, INT32_MAX), 3'600'000);
}

TEST(StatusTest, ALimitThatCannotBeIsNotThere) {
  const auto received = [](const std::string& size) {
    google::rpc::ErrorInfo info;
    (*info.mutable_metadata())["limit_bytes"] = "7";
    (*info.mutable_metadata())["need_bytes"] = std::string(6000, '9');
    (*info.mutable_metadata())["smallest_voxel_size"] = size;
    google::rpc::Status details;
    details.add_details()->PackFrom(info);
    const grpc::Status sent(grpc::StatusCode::RESOURCE_EXHAUSTED, "large", details.SerializeAsString());
    return LimitErrorOf(FromGrpcStatus(sent)).value_or(LimitError());
  };
  EXPECT_EQ(received("1,2,3").smallest_voxel_size, (Vec3d{1, 2, 3}));
  EXPECT_EQ(received("1,2,3").limit_bytes, 7u);
  EXPECT_EQ(received("1,2,3").need_bytes, 0u);
  for (const char* size : {"nan,1,1", "1,inf,1", "1,1,-1", "0,1,1", "1,1", ""}) {
    EXPECT_EQ(received(size).smallest_voxel_size, Vec3d{}) << size;
  }
}

TEST(StatusTest, BrokenDetailsAreNoReasonToFail) {
  const grpc::Status broken(grpc::StatusCode::INTERNAL, "why", "\x0a\xff\xff");
  EXPECT_EQ(FromGrpcStatus(broken), absl::InternalError("why"));
}

}  // namespace
}  // namespace voxelpipe
