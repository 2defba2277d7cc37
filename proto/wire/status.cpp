#include "wire/status.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "base/text.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;

constexpr char kRetryDelayUrl[] = "voxelpipe/retry_delay_ms";
constexpr char kQuotaSubjectUrl[] = "voxelpipe/quota_subject";
constexpr char kMissingMeshUrl[] = "voxelpipe/missing_mesh";
constexpr char kFieldUrl[] = "voxelpipe/field";
constexpr char kMeshType[] = "voxelpipe.v1.StoredMesh";
constexpr char kDomain[] = "voxelpipe";
// Keys of an ErrorInfo's metadata.
constexpr char kNeedBytes[] = "need_bytes", kLimitBytes[] = "limit_bytes", kLargestResolution[] = "largest_resolution",
               kSmallestVoxelSize[] = "smallest_voxel_size";
constexpr char kNotAvailable[] = "NOT_AVAILABLE";
// gRPC limits trailers to 8 KiB in total by default; the message is in them twice, once percent-encoded.
static_assert(kMaxErrorBytes <= 1000);
constexpr size_t kMaxIdBytes = 80;
constexpr milliseconds kInUseDelay{1000};
constexpr milliseconds kMaxDelay{3'600'000};  // a server's delay counts as at most this

google::rpc::ErrorInfo MakeErrorInfo(const char* reason) {
  google::rpc::ErrorInfo info;
  info.set_reason(reason);
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

template <typename Number>
bool ReadNumber(const google::rpc::ErrorInfo& info, const char* key, Number& out) {
  const auto found = info.metadata().find(key);
  if (found == info.metadata().end()) return false;
  const std::string& text = found->second;
  return std::from_chars(text.data(), text.data() + text.size(), out).ec == std::errc();
}

// Parses three positive numbers separated by commas; otherwise `out` is not changed.
void ReadThree(const google::rpc::ErrorInfo& info, const char* key, Vec3d& out) {
  const auto found = info.metadata().find(key);
  if (found == info.metadata().end()) return;
  const char* at = found->second.data();
  const char* const end = at + found->second.size();
  Vec3d read;
  for (int i = 0; i < 3; ++i) {
    const auto number = std::from_chars(at, end, read[i]);
    if (number.ec != std::errc() || (i < 2 && (number.ptr == end || *number.ptr != ','))) return;
    if (!(read[i] > 0) || !std::isfinite(read[i])) return;
    at = number.ptr + 1;
  }
  out = read;
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

absl::Status MissingMeshError(std::string_view mesh_id) {
  absl::Status status = absl::NotFoundError(
      absl::StrCat("the server keeps no mesh '", CleanText(mesh_id, kMaxIdBytes), "'; UploadMesh sends it"));
  status.SetPayload(kMissingMeshUrl, absl::Cord(CleanText(mesh_id, kMaxIdBytes)));
  return status;
}

std::optional<std::string> MissingMesh(const absl::Status& status) {
  const auto payload = status.GetPayload(kMissingMeshUrl);
  if (!payload) return std::nullopt;
  return std::string(*payload);
}

absl::Status WithField(absl::Status status, std::string_view field) {
  status.SetPayload(kFieldUrl, absl::Cord(absl::string_view(field.data(), field.size())));
  return status;
}

absl::Status OfMesh(const absl::Status& status) {
  if (!absl::IsInvalidArgument(status) || status.message().find(": ") != absl::string_view::npos) return status;
  return WithField(status, "mesh");
}

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  if (IsInUseByOthers(status) && !RetryDelay(status)) {
    return ToGrpcStatus(BusyError({status.message().data(), status.message().size()}, kInUseDelay));
  }
  const std::string message = ErrorText(status);
  google::rpc::Status details;
  details.set_code(int(status.code()));  // absl and gRPC use the same numbers for the canonical codes
  details.set_message(message);
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
    } else {
      google::rpc::ErrorInfo info = MakeErrorInfo("LIMIT_EXCEEDED");
      auto& metadata = *info.mutable_metadata();
      metadata["need_and_limit"] = message;
      if (const auto numbers = LimitErrorOf(status)) {
        const Vec3d& size = numbers->smallest_voxel_size;
        if (numbers->need_bytes > 0) metadata[kNeedBytes] = absl::StrCat(numbers->need_bytes);
        metadata[kLimitBytes] = absl::StrCat(numbers->limit_bytes);
        if (numbers->largest_resolution > 0) metadata[kLargestResolution] = absl::StrCat(numbers->largest_resolution);
        if (size.x > 0)
          metadata[kSmallestVoxelSize] =
              absl::StrCat(ExactText(size.x), ",", ExactText(size.y), ",", ExactText(size.z));
      }
      details.add_details()->PackFrom(info);
    }
  } else if (const auto mesh = MissingMesh(status)) {
    google::rpc::ResourceInfo missing;
    missing.set_resource_type(kMeshType);
    missing.set_resource_name(*mesh);
    missing.set_description(message);
    details.add_details()->PackFrom(missing);
  } else if (status.code() == absl::StatusCode::kFailedPrecondition) {
    details.add_details()->PackFrom(MakeErrorInfo(kNotAvailable));
  } else if (status.code() == absl::StatusCode::kUnavailable) {
    if (const auto delay = RetryDelay(status)) details.add_details()->PackFrom(MakeRetryInfo(*delay));
  }
  return grpc::Status(grpc::StatusCode(int(status.code())), message, details.SerializeAsString());
}

absl::Status FromGrpcStatus(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  absl::Status result(absl::StatusCode(int(status.error_code())), status.error_message());
  google::rpc::Status details;
  if (status.error_details().empty() || !details.ParseFromString(status.error_details())) return result;
  for (const google::protobuf::Any& detail : details.details()) {
    google::rpc::ErrorInfo info;
    LimitError numbers;
    if (absl::IsResourceExhausted(result) && detail.Is<google::rpc::ErrorInfo>() && detail.UnpackTo(&info) &&
        ReadNumber(info, kLimitBytes, numbers.limit_bytes)) {
      // Values that do not apply are absent.
      ReadNumber(info, kNeedBytes, numbers.need_bytes);
      ReadNumber(info, kLargestResolution, numbers.largest_resolution);
      ReadThree(info, kSmallestVoxelSize, numbers.smallest_voxel_size);
      result = MakeLimitError(status.error_message(), numbers);
    }
    google::rpc::ResourceInfo missing;
    if (detail.Is<google::rpc::ResourceInfo>() && detail.UnpackTo(&missing) && missing.resource_type() == kMeshType) {
      result.SetPayload(kMissingMeshUrl, absl::Cord(missing.resource_name()));
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
