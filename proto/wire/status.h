// Status of a job <-> status of a call, with google.rpc details.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace voxelpipe {

// RESOURCE_EXHAUSTED because of load: trying again after `delay` may work. The delay travels as google.rpc.RetryInfo.
absl::Status BusyError(std::string_view message, std::chrono::milliseconds delay);
// RESOURCE_EXHAUSTED because `subject` ("client:NAME") has used up what it may: a BusyError that carries
// google.rpc.QuotaFailure, too.
absl::Status QuotaError(std::string_view message, std::string_view subject, std::chrono::milliseconds delay);
// UNAVAILABLE for a while: trying again after `delay` may work.
absl::Status NotServingError(std::string_view message, std::chrono::milliseconds delay);
// The delay of either, on both sides of the wire.
std::optional<std::chrono::milliseconds> RetryDelay(const absl::Status& status);

// NOT_FOUND because the server keeps no mesh of this id, which travels as google.rpc.ResourceInfo.
absl::Status MissingMeshError(std::string_view mesh_id);
// The id of a MissingMeshError, on either side of the wire.
std::optional<std::string> MissingMesh(const absl::Status& status);

// FAILED_PRECONDITION because the result takes, or may take, more bytes than a call without a stream carries.
absl::Status NeedsStreamError(uint64_t need_bytes, uint64_t limit_bytes);
// True if it is one, on either side of the wire.
bool NeedsStream(const absl::Status& status);

// The same status, INVALID_ARGUMENT, as one about this part of the request ("mesh"), which the message need not name.
absl::Status WithField(absl::Status status, std::string_view field);

// The one place where a job's status becomes a call's. The code stays, the message is ErrorText; the details are
//   INVALID_ARGUMENT      BadRequest: field = that of WithField, description = the message; else field = the message's text before the first ": ",
//                         description = the rest
//   RESOURCE_EXHAUSTED    RetryInfo for a BusyError and where others use what is needed (IsInUseByOthers), with
//                         QuotaFailure for a QuotaError; otherwise ErrorInfo "LIMIT_EXCEEDED" with the message as
//                         need_and_limit, and need_bytes, limit_bytes, largest_resolution and smallest_voxel_size as
//                         numbers where they are known and apply (LimitErrorOf)
//   NOT_FOUND             ResourceInfo for a MissingMeshError: type "voxelpipe.v1.StoredMesh", name the mesh's id
//   FAILED_PRECONDITION   ErrorInfo "RESULT_NEEDS_STREAM" with need_bytes, limit_bytes and use_rpc for a NeedsStreamError; otherwise "NOT_AVAILABLE"
//   UNAVAILABLE           RetryInfo for a NotServingError
grpc::Status ToGrpcStatus(const absl::Status& status);

// The client's half: RetryDelay, LimitErrorOf, MissingMesh and NeedsStream work on what comes out. Messages that are
// not valid UTF-8 cannot come; all other details stay on the wire.
absl::Status FromGrpcStatus(const grpc::Status& status);

}  // namespace voxelpipe
