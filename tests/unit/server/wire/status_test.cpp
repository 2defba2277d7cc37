#include "wire/status.h"

#include <chrono>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "base/limit_error.h"
#include "base/text.h"
#include "gmock/gmock.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "gtest/gtest.h"
#include "voxelpipe/v1/error.pb.h"

namespace voxelpipe {
namespace {

google::rpc::Status Details(const grpc::Status& status) {
  google::rpc::Status details;
  EXPECT_TRUE(details.ParseFromString(status.error_details()));
  EXPECT_EQ(details.code(), int(status.error_code()));
  EXPECT_EQ(details.message(), status.error_message());
  return details;
}

// Of the ErrorInfo, the first detail of every status.
std::string Reason(const grpc::Status& status) {
  const google::rpc::Status details = Details(status);
  google::rpc::ErrorInfo info;
  EXPECT_TRUE(details.details_size() > 0 && details.details(0).UnpackTo(&info)) << details.DebugString();
  EXPECT_EQ(info.domain(), "voxelpipe");
  EXPECT_TRUE(info.metadata().empty());
  return info.reason();
}

// The one detail of a status besides, which must be of type T.
template <typename T>
T Detail(const grpc::Status& status) {
  const google::rpc::Status details = Details(status);
  T detail;
  EXPECT_TRUE(details.details_size() == 2 && details.details(1).UnpackTo(&detail)) << details.DebugString();
  return detail;
}

// The only violation of a request.
google::rpc::BadRequest::FieldViolation Violation(const grpc::Status& status) {
  const auto bad = Detail<google::rpc::BadRequest>(status);
  EXPECT_EQ(bad.field_violations_size(), 1);
  return bad.field_violations_size() == 1 ? bad.field_violations(0) : google::rpc::BadRequest::FieldViolation();
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

// The list of the contract (voxelization_service.proto).
TEST(StatusTest, EveryErrorHasItsReason) {
  const auto reason = [](const absl::Status& status) { return Reason(ToGrpcStatus(status)); };
  constexpr std::chrono::milliseconds kDelay(10);
  EXPECT_EQ(reason(absl::InvalidArgumentError("grid.padding: must not be negative")), "INVALID_REQUEST");
  EXPECT_EQ(reason(absl::InvalidArgumentError("no field at all")), "INVALID_REQUEST");
  EXPECT_EQ(reason(OfMesh(absl::InvalidArgumentError("GLB: byte 8: the length"))), "INVALID_MESH");
  EXPECT_EQ(reason(OfMesh(absl::InvalidArgumentError("not a mesh"))), "INVALID_MESH");
  EXPECT_EQ(reason(absl::ResourceExhaustedError("the mesh is too large")), "LIMIT_EXCEEDED");
  EXPECT_EQ(reason(MakeLimitError("too large", {2, 1})), "LIMIT_EXCEEDED");
  EXPECT_EQ(reason(MarkInUseByOthers(MakeLimitError("not now", {2, 1}))), "OVERLOADED");
  EXPECT_EQ(reason(BusyError("the queue is full", kDelay)), "OVERLOADED");
  EXPECT_EQ(reason(QuotaError("calls", "client:farm", kDelay)), "QUOTA_EXCEEDED");
  EXPECT_EQ(reason(absl::FailedPreconditionError("backend: this server has no cuda worker")), "BACKEND_NOT_AVAILABLE");
  EXPECT_EQ(reason(MissingMeshError("meshes/a")), "MESH_NOT_FOUND");
  EXPECT_EQ(reason(absl::UnavailableError("the server shuts down")), "SHUTTING_DOWN");
  EXPECT_EQ(reason(NotServingError("cuda:0 is quarantined", kDelay)), "DEVICES_FAILED");
  EXPECT_EQ(reason(absl::UnauthenticatedError("no token")), "TOKEN_REJECTED");
  EXPECT_EQ(reason(absl::PermissionDeniedError("no claim")), "NOT_PERMITTED");
  EXPECT_EQ(reason(absl::DataLossError("the CRC-32C")), "CHECKSUM_MISMATCH");
  EXPECT_EQ(reason(absl::AbortedError("too slow")), "CLIENT_TOO_SLOW");
  EXPECT_EQ(reason(absl::CancelledError("")), "CANCELLED");
  EXPECT_EQ(reason(absl::DeadlineExceededError("")), "DEADLINE_EXCEEDED");
  EXPECT_EQ(reason(absl::InternalError("")), "INTERNAL");
}

// Not one detail more: INVALID_ARGUMENT, some RESOURCE_EXHAUSTED, NOT_FOUND and UNAVAILABLE have another (below).
TEST(StatusTest, OtherErrorsHaveNothingElse) {
  for (const absl::Status& status :
       {absl::ResourceExhaustedError("a"), absl::FailedPreconditionError("a"), absl::UnavailableError("a"),
        absl::UnauthenticatedError("a"), absl::PermissionDeniedError("a"), absl::DataLossError("a"),
        absl::AbortedError("a"), absl::CancelledError("a"), absl::DeadlineExceededError("a"), absl::InternalError("a"),
        absl::NotFoundError("a")}) {
    EXPECT_EQ(Details(ToGrpcStatus(status)).details_size(), 1) << status;
  }
}

TEST(StatusTest, AnInvalidArgumentNamesTheField) {
  const auto violation =
      Violation(ToGrpcStatus(absl::InvalidArgumentError("targets[1].blend: blend 'or': not for f32")));
  EXPECT_EQ(violation.field(), "targets[1].blend");
  EXPECT_EQ(violation.description(), "blend 'or': not for f32");
}

TEST(StatusTest, AFieldThatTheMessageDoesNotNameLeavesTheMessageAsItIs) {
  const grpc::Status sent =
      ToGrpcStatus(WithField(absl::InvalidArgumentError("no mesh: neither this nor that"), "mesh"));
  EXPECT_EQ(sent.error_message(), "no mesh: neither this nor that");
  EXPECT_EQ(Violation(sent).field(), "mesh");
  EXPECT_EQ(Violation(sent).description(), "no mesh: neither this nor that");
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
    const auto violation = Violation(ToGrpcStatus(absl::InvalidArgumentError(message)));
    return violation.field() + " | " + violation.description();
  };
  EXPECT_EQ(field("glTF: mesh 0, primitive 1: accessor 2: index 9"), "glTF: mesh 0, primitive 1 | accessor 2: index 9");
  EXPECT_EQ(field("GLB: byte 8: the length"), "GLB: byte 8 | the length");
  EXPECT_EQ(field("glTF: node 0 is part of a cycle"), "glTF | node 0 is part of a cycle");
  EXPECT_EQ(field("glTF: the name 'a: b' is wrong"), "glTF | the name 'a: b' is wrong");
}

TEST(StatusTest, AnInvalidArgumentWithoutAFieldKeepsItsWholeText) {
  const auto violation = Violation(ToGrpcStatus(absl::InvalidArgumentError("not a mesh")));
  EXPECT_EQ(violation.field(), "");
  EXPECT_EQ(violation.description(), "not a mesh");
}

TEST(StatusTest, ALimitWithoutNumbersIsNoReasonToRetry) {
  const grpc::Status sent = ToGrpcStatus(absl::ResourceExhaustedError("9 targets are too many"));
  EXPECT_EQ(Reason(sent), "LIMIT_EXCEEDED");
  EXPECT_EQ(Details(sent).details_size(), 1);
  EXPECT_FALSE(RetryDelay(FromGrpcStatus(sent)).has_value());
  EXPECT_FALSE(LimitErrorOf(FromGrpcStatus(sent)).has_value());
}

TEST(StatusTest, ALimitsNumbersAreFieldsOnBothSides) {
  const grpc::Status sent = ToGrpcStatus(MakeLimitError("too large", {uint64_t{1} << 62, 9, 4}));
  const auto message = Detail<v1::LimitExceeded>(sent);
  EXPECT_EQ(message.need_bytes(), int64_t{1} << 62);
  EXPECT_EQ(message.limit_bytes(), 9);
  EXPECT_EQ(message.resolution(), 4);
  const absl::Status received = FromGrpcStatus(sent);
  EXPECT_EQ(received.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(std::string(received.message()), "too large");
  const auto numbers = LimitErrorOf(received);
  ASSERT_TRUE(numbers.has_value());
  EXPECT_EQ(numbers->need_bytes, uint64_t{1} << 62);
  EXPECT_EQ(numbers->limit_bytes, 9u);
  EXPECT_EQ(numbers->largest_resolution, 4);
  // What does not apply, or cannot be counted, is not there.
  LimitError voxels;
  voxels.limit_bytes = 7;
  voxels.smallest_voxel_size = {0.25, 1.0 / 3, 1e-200};
  const grpc::Status in_voxels = ToGrpcStatus(MakeLimitError("too fine", voxels));
  const auto of_voxels = Detail<v1::LimitExceeded>(in_voxels);
  EXPECT_FALSE(of_voxels.has_need_bytes());
  EXPECT_EQ(of_voxels.largest_grid_case(), v1::LimitExceeded::kVoxelSize);
  const auto voxels_back = LimitErrorOf(FromGrpcStatus(in_voxels));
  ASSERT_TRUE(voxels_back.has_value());
  EXPECT_EQ(voxels_back->limit_bytes, 7u);
  EXPECT_EQ(voxels_back->smallest_voxel_size.y, 1.0 / 3);
  EXPECT_EQ(voxels_back->smallest_voxel_size.x, 0.25);
  EXPECT_EQ(voxels_back->smallest_voxel_size.z, 1e-200);
  const auto neither = Detail<v1::LimitExceeded>(ToGrpcStatus(MakeLimitError("too large", {8, 7})));
  EXPECT_EQ(neither.largest_grid_case(), v1::LimitExceeded::LARGEST_GRID_NOT_SET);
}

TEST(StatusTest, ANeedBeyond63BitsIsNotThere) {
  for (const uint64_t need : {uint64_t{1} << 63, UINT64_MAX}) {
    const grpc::Status sent = ToGrpcStatus(MakeLimitError("too large", {need, 9, 4}));
    EXPECT_FALSE(Detail<v1::LimitExceeded>(sent).has_need_bytes()) << need;
    const auto numbers = LimitErrorOf(FromGrpcStatus(sent));
    ASSERT_TRUE(numbers.has_value());
    EXPECT_EQ(numbers->need_bytes, 0u);
    EXPECT_EQ(numbers->limit_bytes, 9u);
  }
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
  const std::string name = "meshes/" + std::string(64, 'a') + "-mm-3mf";
  EXPECT_EQ(MissingMesh(MissingMeshError(name)), name);
  const grpc::Status sent = ToGrpcStatus(MissingMeshError(name));
  EXPECT_EQ(sent.error_code(), grpc::StatusCode::NOT_FOUND);
  const auto missing = Detail<google::rpc::ResourceInfo>(sent);
  EXPECT_EQ(missing.resource_type(), "voxelpipe.v1.Mesh");
  EXPECT_EQ(missing.resource_name(), name);
  EXPECT_EQ(missing.description(), sent.error_message());
  EXPECT_EQ(MissingMesh(FromGrpcStatus(sent)), name);
  EXPECT_FALSE(MissingMesh(FromGrpcStatus(ToGrpcStatus(absl::NotFoundError("something else")))).has_value());
}

TEST(StatusTest, MissingMeshesAreNamedAndCounted) {
  std::vector<std::string> names;
  for (int i = 0; i < 200; ++i) names.push_back("meshes/" + std::string(61, 'a') + std::to_string(i + 100));
  const absl::Status few = MissingMeshesError(std::span(names).first(3));
  EXPECT_THAT(std::string(few.message()), ::testing::HasSubstr("none of 3 meshes"));
  EXPECT_EQ(MissingMeshes(few), std::vector<std::string>(names.begin(), names.begin() + 3));
  EXPECT_EQ(MissingMeshes(FromGrpcStatus(ToGrpcStatus(few))), MissingMeshes(few));
  EXPECT_EQ(MissingMesh(few), names[0]);
  EXPECT_EQ(Details(ToGrpcStatus(few)).details_size(), 4) << "and the reason";
  EXPECT_EQ(MissingMeshesError(std::span(names).first(1)), MissingMeshError(names[0]));
  EXPECT_TRUE(MissingMeshes(absl::NotFoundError("something else")).empty());

  const absl::Status many = MissingMeshesError(names);
  EXPECT_THAT(std::string(many.message()), ::testing::HasSubstr("none of 200 meshes"));
  EXPECT_EQ(MissingMeshes(many), std::vector<std::string>(names.begin(), names.begin() + 100));
  EXPECT_EQ(ToRpcStatus(many).details_size(), 101);
  const grpc::Status sent = ToGrpcStatus(many);
  EXPECT_LE(sent.error_message().size() + sent.error_details().size() * 4 / 3, 7800u) << "trailers hold 8 KiB";
  const std::vector<std::string> told = MissingMeshes(FromGrpcStatus(sent));
  EXPECT_GT(told.size(), 25u);
  EXPECT_EQ(told, std::vector<std::string>(names.begin(), names.begin() + long(told.size())));
}

TEST(StatusTest, StrangersBytesInAMessageBecomeValidText) {
  const grpc::Status sent = ToGrpcStatus(absl::InvalidArgumentError("node '\xff\n': broken"));
  EXPECT_EQ(sent.error_message(), "node '\?\?': broken");
  EXPECT_EQ(Violation(sent).description(), "broken");
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
  const auto received = [](const v1::LimitExceeded& limit) {
    google::rpc::Status details;
    details.add_details()->PackFrom(limit);
    const grpc::Status sent(grpc::StatusCode::RESOURCE_EXHAUSTED, "large", details.SerializeAsString());
    return LimitErrorOf(FromGrpcStatus(sent)).value_or(LimitError());
  };
  v1::LimitExceeded limit;
  limit.set_limit_bytes(7);
  limit.set_need_bytes(-1);
  limit.set_resolution(std::numeric_limits<int64_t>::min());
  EXPECT_EQ(received(limit).limit_bytes, 7u);
  EXPECT_EQ(received(limit).need_bytes, 0u);
  EXPECT_EQ(received(limit).largest_resolution, 0);
  const auto size = [&](double x, double y, double z) {
    limit.mutable_voxel_size()->set_x(x);
    limit.mutable_voxel_size()->set_y(y);
    limit.mutable_voxel_size()->set_z(z);
    return received(limit).smallest_voxel_size;
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(size(1, 2, 3), (Vec3d{1, 2, 3}));
  for (const Vec3d& wrong : {Vec3d{kNan, 1, 1}, {1, kInf, 1}, {1, 1, -1}, {0, 1, 1}}) {
    EXPECT_EQ(size(wrong.x, wrong.y, wrong.z), Vec3d{});
  }
}

TEST(StatusTest, BrokenDetailsAreNoReasonToFail) {
  const grpc::Status broken(grpc::StatusCode::INTERNAL, "why", "\x0a\xff\xff");
  EXPECT_EQ(FromGrpcStatus(broken), absl::InternalError("why"));
}

}  // namespace
}  // namespace voxelpipe
