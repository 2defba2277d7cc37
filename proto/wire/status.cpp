#include "wire/status.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>

#include "absl/strings/cord.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "base/limit_error.h"
#include "base/text.h"
#include "google/rpc/error_details.pb.h"
#include "voxelpipe/v1/error.pb.h"
#include "wire/count.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;

constexpr char kRetryDelayUrl[] = "voxelpipe/retry_delay_ms";
constexpr char kQuotaSubjectUrl[] = "voxelpipe/quota_subject";
constexpr char kMissingMeshUrl[] = "voxelpipe/missing_mesh";  // names, with a line end between two
constexpr char kFieldUrl[] = "voxelpipe/field";
constexpr char kMeshType[] = "voxelpipe.v1.Mesh";
constexpr char kDomain[] = "voxelpipe";
constexpr char kReasonUrl[] = "voxelpipe/reason";
// gRPC limits trailers to 8 KiB in total by default; the message is in them twice, once percent-encoded.
static_assert(kMaxErrorBytes <= 1000);
constexpr size_t kMaxNameBytes = 80;
// Of google.rpc.Status in trailers: three quarters of what the message leaves, because it may travel as base64.
constexpr size_t kMaxDetailBytes = 4800;
constexpr milliseconds kInUseDelay{1000};
constexpr milliseconds kMaxDelay{3'600'000};  // a server's delay counts as at most this

google::rpc::ErrorInfo MakeErrorInfo(std::string reason) {
  google::rpc::ErrorInfo info;
  info.set_reason(std::move(reason));
  info.set_domain(kDomain);
  return info;
}

google::rpc::RetryInfo MakeRetryInfo(std::chrono::milliseconds delay) {
  google::rpc::RetryInfo retry;
  retry.mutable_retry_delay()->set_seconds(delay.count() / 1000);
  retry.mutable_retry_delay()->set_nanos(int32_t(delay.count() % 1000 * 1'000'000));
  return retry;
}

// The end of the location that an INVALID_ARGUMENT names before the reason: one part in "targets[0].blend: ...", two
// for a mesh file, "glTF: mesh 0, primitive 0: ...". npos if it names none. Quoted text is untrusted.
size_t EndOfPlace(std::string_view message) {
  const size_t end = message.find(": ");
  if (end == message.npos || !(message.starts_with("glTF: ") || message.starts_with("GLB: "))) return end;
  const size_t next = message.find(": ", end + 2);
  return next < message.find('\'', end) ? next : end;
}

// The reason of an error's ErrorInfo: the list in voxelization_service.proto.
std::string ReasonOf(const absl::Status& status) {
  if (const auto reason = status.GetPayload(kReasonUrl)) return std::string(*reason);
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:  // a vertex: what DescribeVertex gives
      return absl::StartsWith(status.message(), "node ") || absl::StartsWith(status.message(), "vertex ")
                 ? "INVALID_MESH"
                 : "INVALID_REQUEST";
    case absl::StatusCode::kResourceExhausted:
      if (!RetryDelay(status)) return "LIMIT_EXCEEDED";
      return status.GetPayload(kQuotaSubjectUrl) ? "QUOTA_EXCEEDED" : "OVERLOADED";
    case absl::StatusCode::kFailedPrecondition: return "BACKEND_NOT_AVAILABLE";
    case absl::StatusCode::kNotFound: return "MESH_NOT_FOUND";
    case absl::StatusCode::kUnavailable: return RetryDelay(status) ? "DEVICES_FAILED" : "SHUTTING_DOWN";
    case absl::StatusCode::kUnauthenticated: return "TOKEN_REJECTED";
    case absl::StatusCode::kPermissionDenied: return "NOT_PERMITTED";
    case absl::StatusCode::kDataLoss: return "CHECKSUM_MISMATCH";
    case absl::StatusCode::kAborted: return "CLIENT_TOO_SLOW";
    case absl::StatusCode::kCancelled: return "CANCELLED";
    case absl::StatusCode::kDeadlineExceeded: return "DEADLINE_EXCEEDED";
    default: return "INTERNAL";
  }
}

v1::LimitExceeded ToMessage(const LimitError& numbers) {
  v1::LimitExceeded message;
  constexpr uint64_t kMaxBytes = std::numeric_limits<int64_t>::max();
  if (numbers.need_bytes > 0 && numbers.need_bytes <= kMaxBytes) message.set_need_bytes(int64_t(numbers.need_bytes));
  message.set_limit_bytes(int64_t(numbers.limit_bytes));
  const Vec3d& size = numbers.smallest_voxel_size;
  if (numbers.largest_resolution > 0) {
    message.set_resolution(numbers.largest_resolution);
  } else if (size.x > 0) {
    message.mutable_voxel_size()->set_x(size.x);
    message.mutable_voxel_size()->set_y(size.y);
    message.mutable_voxel_size()->set_z(size.z);
  }
  return message;
}

LimitError FromMessage(const v1::LimitExceeded& message) {
  LimitError numbers;
  numbers.need_bytes = CountOf(message.need_bytes());
  numbers.limit_bytes = CountOf(message.limit_bytes());
  numbers.largest_resolution = std::max<int64_t>(message.resolution(), 0);
  const Vec3d size{message.voxel_size().x(), message.voxel_size().y(), message.voxel_size().z()};
  const auto good = [](double value) { return value > 0 && std::isfinite(value); };
  if (good(size.x) && good(size.y) && good(size.z)) numbers.smallest_voxel_size = size;
  return numbers;
}

}  // namespace

absl::Status BusyError(std::string_view message, std::chrono::milliseconds delay) {
  absl::Status status = absl::ResourceExhaustedError(absl::string_view(message.data(), message.size()));
  status.SetPayload(kRetryDelayUrl, absl::Cord(absl::StrCat(delay.count())));
  return status;
}

absl::Status QuotaError(std::string_view message, std::string_view subject, std::chrono::milliseconds delay) {
  absl::Status status = BusyError(message, delay);
  status.SetPayload(kQuotaSubjectUrl, absl::Cord(absl::string_view(subject.data(), subject.size())));
  return status;
}

absl::Status NotServingError(std::string_view message, std::chrono::milliseconds delay) {
  absl::Status status = absl::UnavailableError(absl::string_view(message.data(), message.size()));
  status.SetPayload(kRetryDelayUrl, absl::Cord(absl::StrCat(delay.count())));
  return status;
}

std::optional<std::chrono::milliseconds> RetryDelay(const absl::Status& status) {
  const auto payload = status.GetPayload(kRetryDelayUrl);
  if (!payload) return std::nullopt;
  const std::string text(*payload);
  int64_t ms = 0;
  if (std::from_chars(text.data(), text.data() + text.size(), ms).ec != std::errc()) return std::nullopt;
  return std::chrono::milliseconds(ms);
}

absl::Status MissingMeshError(std::string_view name) {
  absl::Status status = absl::NotFoundError(
      absl::StrCat("the server keeps no mesh '", CleanText(name, kMaxNameBytes), "'; UploadMesh sends it"));
  status.SetPayload(kMissingMeshUrl, absl::Cord(CleanText(name, kMaxNameBytes)));
  return status;
}

absl::Status MissingMeshesError(std::span<const std::string> names) {
  if (names.size() == 1) return MissingMeshError(names[0]);
  std::vector<std::string> told;
  for (const std::string& name : names.first(std::min(names.size(), kMaxMissingMeshes))) {
    told.push_back(CleanText(name, kMaxNameBytes));
  }
  absl::Status status = absl::NotFoundError(absl::StrCat("the server keeps none of ", names.size(), " meshes, '",
                                                         told.front(), "' among them; UploadMesh sends them"));
  status.SetPayload(kMissingMeshUrl, absl::Cord(absl::StrJoin(told, "\n")));
  return status;
}

std::vector<std::string> MissingMeshes(const absl::Status& status) {
  const auto payload = status.GetPayload(kMissingMeshUrl);
  if (!payload) return {};
  return absl::StrSplit(std::string(*payload), '\n');
}

std::optional<std::string> MissingMesh(const absl::Status& status) {
  const std::vector<std::string> names = MissingMeshes(status);
  if (names.empty()) return std::nullopt;
  return names.front();
}

absl::Status WithField(absl::Status status, std::string_view field) {
  status.SetPayload(kFieldUrl, absl::Cord(absl::string_view(field.data(), field.size())));
  return status;
}

absl::Status OfMesh(absl::Status status) {
  if (!absl::IsInvalidArgument(status)) return status;
  status.SetPayload(kReasonUrl, absl::Cord("INVALID_MESH"));
  if (status.message().find(": ") != absl::string_view::npos) return status;
  return WithField(std::move(status), "mesh");
}

google::rpc::Status ToRpcStatus(const absl::Status& status) {
  if (IsInUseByOthers(status) && !RetryDelay(status)) {
    return ToRpcStatus(BusyError({status.message().data(), status.message().size()}, kInUseDelay));
  }
  const std::string message = ErrorText(status);
  google::rpc::Status details;
  details.set_code(int(status.code()));  // absl and gRPC use the same numbers for the canonical codes
  details.set_message(message);
  details.add_details()->PackFrom(MakeErrorInfo(ReasonOf(status)));
  if (status.code() == absl::StatusCode::kInvalidArgument) {
    google::rpc::BadRequest bad;
    auto* violation = bad.add_field_violations();
    const auto field = status.GetPayload(kFieldUrl);
    const size_t colon = field ? std::string::npos : EndOfPlace(message);
    violation->set_field(field ? std::string(*field) : colon == std::string::npos ? "" : message.substr(0, colon));
    violation->set_description(colon == std::string::npos ? message : message.substr(colon + 2));
    details.add_details()->PackFrom(bad);
  } else if (status.code() == absl::StatusCode::kResourceExhausted) {
    if (const auto delay = RetryDelay(status)) {
      details.add_details()->PackFrom(MakeRetryInfo(*delay));
      if (const auto subject = status.GetPayload(kQuotaSubjectUrl)) {
        google::rpc::QuotaFailure quota;
        quota.add_violations()->set_subject(std::string(*subject));
        quota.mutable_violations(0)->set_description(message);
        details.add_details()->PackFrom(quota);
      }
    } else if (const auto numbers = LimitErrorOf(status)) {
      details.add_details()->PackFrom(ToMessage(*numbers));
    }
  } else if (const std::vector<std::string> meshes = MissingMeshes(status); !meshes.empty()) {
    for (const std::string& mesh : meshes) {
      google::rpc::ResourceInfo missing;
      missing.set_resource_type(kMeshType);
      missing.set_resource_name(mesh);
      if (meshes.size() == 1) missing.set_description(message);
      details.add_details()->PackFrom(missing);
    }
  } else if (status.code() == absl::StatusCode::kUnavailable) {
    if (const auto delay = RetryDelay(status)) details.add_details()->PackFrom(MakeRetryInfo(*delay));
  }
  return details;
}

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status();  // not grpc::Status::OK, for which the Python module would load gRPC
  google::rpc::Status details = ToRpcStatus(status);
  // Only lists of names are so long.
  while (details.ByteSizeLong() > kMaxDetailBytes && details.details_size() > 1)
    details.mutable_details()->RemoveLast();
  return grpc::Status(grpc::StatusCode(details.code()), details.message(), details.SerializeAsString());
}

absl::Status FromGrpcStatus(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  absl::Status result(absl::StatusCode(int(status.error_code())), status.error_message());
  google::rpc::Status details;
  if (status.error_details().empty() || !details.ParseFromString(status.error_details())) return result;
  for (const google::protobuf::Any& detail : details.details()) {
    v1::LimitExceeded limit;
    if (absl::IsResourceExhausted(result) && detail.Is<v1::LimitExceeded>() && detail.UnpackTo(&limit) &&
        limit.has_limit_bytes()) {
      result = MakeLimitError(status.error_message(), FromMessage(limit));
    }
    google::rpc::ResourceInfo missing;
    if (detail.Is<google::rpc::ResourceInfo>() && detail.UnpackTo(&missing) && missing.resource_type() == kMeshType) {
      absl::Cord names = result.GetPayload(kMissingMeshUrl).value_or(absl::Cord());
      if (!names.empty()) names.Append("\n");
      names.Append(missing.resource_name());
      result.SetPayload(kMissingMeshUrl, std::move(names));
    }
    google::rpc::RetryInfo retry;
    if (detail.Is<google::rpc::RetryInfo>() && detail.UnpackTo(&retry)) {
      const int64_t seconds =
          std::clamp<int64_t>(retry.retry_delay().seconds(), -1, kMaxDelay / std::chrono::seconds(1));
      const milliseconds delay(seconds * 1000 + retry.retry_delay().nanos() / 1'000'000);
      const milliseconds kept = std::clamp(delay, milliseconds(0), kMaxDelay);
      result.SetPayload(kRetryDelayUrl, absl::Cord(absl::StrCat(kept.count())));
    }
  }
  return result;
}

}  // namespace voxelpipe
