// Status of a job <-> status of a call, with google.rpc details.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <grpcpp/support/status.h>

#include "absl/status/status.h"
#include "google/rpc/status.pb.h"

namespace voxelpipe {

// RESOURCE_EXHAUSTED because of load: a retry after `delay` may succeed. The delay is sent as google.rpc.RetryInfo.
absl::Status BusyError(std::string_view message, std::chrono::milliseconds delay);
// RESOURCE_EXHAUSTED because `subject` ("client:NAME") has used up a quota: a BusyError with google.rpc.QuotaFailure in
// addition.
absl::Status QuotaError(std::string_view message, std::string_view subject, std::chrono::milliseconds delay);
// UNAVAILABLE for a while: a retry after `delay` may succeed.
absl::Status NotServingError(std::string_view message, std::chrono::milliseconds delay);
// The delay of these errors, in server and client; of what a client received 0 to an hour.
std::optional<std::chrono::milliseconds> RetryDelay(const absl::Status& status);

// NOT_FOUND because the server has no stored mesh of this name, which is sent as google.rpc.ResourceInfo.
absl::Status MissingMeshError(std::string_view name);
// The same for several names, at least one: the text has their number, and at most kMaxMissingMeshes are sent.
inline constexpr size_t kMaxMissingMeshes = 100;
absl::Status MissingMeshesError(std::span<const std::string> names);
// The names of these errors that were sent, in server and client; empty for all other statuses.
std::vector<std::string> MissingMeshes(const absl::Status& status);
// The first of them.
std::optional<std::string> MissingMesh(const absl::Status& status);

// Attaches the field of the request ("mesh") to an INVALID_ARGUMENT status whose message does not name it.
absl::Status WithField(absl::Status status, std::string_view field);

// In: an error of loading a mesh. Out: the same; an INVALID_ARGUMENT that names no part of the file, before a ": ", has
// the field "mesh". Its reason is INVALID_MESH.
absl::Status OfMesh(absl::Status status);

// Converts a job's status to a call's; no other code does. The code stays, the message is ErrorText; the details are an
// ErrorInfo, whose reasons voxelization_service.proto lists, and
//   INVALID_ARGUMENT      BadRequest: field = that of WithField, description = the message; otherwise field = the text
//                         of the message before the first ": ", description = the rest
//   RESOURCE_EXHAUSTED    RetryInfo for a BusyError and if other requests use the memory (IsInUseByOthers), with
//                         QuotaFailure for a QuotaError; otherwise LimitExceeded if there are numbers (LimitErrorOf)
//   NOT_FOUND             ResourceInfo for each name of a MissingMeshError: type "voxelpipe.v1.Mesh", name the mesh's
//   UNAVAILABLE           RetryInfo for a NotServingError
// Names that trailers do not hold beside the rest are left out.
grpc::Status ToGrpcStatus(const absl::Status& status);
// The same as a message, which holds all names.
google::rpc::Status ToRpcStatus(const absl::Status& status);

// The inverse, for clients: RetryDelay, LimitErrorOf and MissingMesh accept its result. Messages are
// always valid UTF-8; all other details are dropped.
absl::Status FromGrpcStatus(const grpc::Status& status);

}  // namespace voxelpipe
