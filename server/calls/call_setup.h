// The first steps of every call that runs a job.
#pragma once

#include <cstdint>
#include <deque>
#include <string>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "job/request.h"
#include "schedule/byte_budget.h"
#include "schedule/task.h"
#include "state/service_state.h"
#include "wire/request.h"

namespace voxelpipe {

// Gives the job the call's deadline, if it has one.
void SetDeadline(const grpc::CallbackServerContext& context, JobContext& job);

// The error of calls after the gate was closed. UNAVAILABLE: another server, or this one later, may accept it.
absl::Status ShuttingDownError();

// Checks that a call may continue: the first check of each. In: CallRecord::admission. Errors: ShuttingDownError; a
// BusyError beyond --max-calls; `admission`.
absl::Status MayBegin(const CallGate::Pass& pass, const absl::Status& admission);

// Sets the operator's choices (threads, backend, instruction set) in a client's request and checks everything that
// needs no mesh. Errors: INVALID_ARGUMENT naming the field.
absl::Status PrepareRequest(const ServiceState& state, VoxelizeRequest& request);

// Which kinds of device may run a request after PrepareRequest, into traits.backend and traits.fallback. `asked` is the
// choice that came with it: where the server made the choice, not the client, another kind of device may run the job.
void ChooseKinds(const ServiceState& state, BackendChoice asked, const ParsedConfig& config, TaskTraits& traits);

// Charges `uploads` for the next `bytes` of a mesh file of which `so_far` have arrived. RESOURCE_EXHAUSTED if the file
// becomes too large, with RetryInfo if there are too many uploads at the same time.
absl::Status TakeUploadBytes(const ServiceState& state, uint64_t so_far, uint64_t bytes, BudgetShare& uploads);

// Charges `uploads` for the list of placed meshes of a request, if it has one. A BusyError like that of uploads.
absl::Status TakeListBytes(const ParsedConfig& config, BudgetShare& uploads);

// Appends a piece of a mesh file. Small ones are merged: each string has an overhead, and only bytes are counted.
void AppendPiece(std::string piece, std::deque<std::string>& pieces);

}  // namespace voxelpipe
