// What every call that runs a job does first.
#pragma once

#include <cstdint>
#include <deque>
#include <string>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "calls/call_record.h"
#include "job/request.h"
#include "schedule/byte_budget.h"
#include "state/service_state.h"

namespace voxelpipe {

// Gives the job the call's deadline, if it has one.
void SetDeadline(const grpc::CallbackServerContext& context, JobContext& job);

// What a call gets that comes after the gate was closed. UNAVAILABLE: another server, or this one later, may take it.
absl::Status ShuttingDownError();

// Checks that a call may go on: the first check of each. Errors: ShuttingDownError; a BusyError beyond --max-calls;
// those of CallRecord::admission.
absl::Status MayBegin(const CallGate::Pass& pass, const CallRecord& record);

// Puts the operator's choices (threads, backend, instruction set) into a client's request and checks all of it that
// needs no mesh.
// Errors: INVALID_ARGUMENT naming the field.
absl::Status PrepareRequest(const ServiceState& state, VoxelizeRequest& request);

// Room in `uploads` for the next `bytes` of a mesh file of which `so_far` have come. RESOURCE_EXHAUSTED where the file
// grows too large, with RetryInfo where too many come at the same time.
absl::Status TakeUploadBytes(const ServiceState& state, uint64_t so_far, uint64_t bytes, BudgetShare& uploads);

// Puts a piece of a mesh file behind those before it. Small ones are brought together: each string of its own costs
// more than a few bytes, and only bytes are counted.
void AppendPiece(std::string piece, std::deque<std::string>& pieces);

}  // namespace voxelpipe
