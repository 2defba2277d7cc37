// The messages of a call, handed to a sink.
#pragma once

#include <functional>
#include <string>

#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"
#include "job/request.h"
#include "job/result.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// The messages are those of this server's own service, without compression, so their order and checksums are not
// checked again.
class ResultFeed {
 public:
  // `may_begin` is asked before the sink, with the header. All must outlive the object.
  ResultFeed(const VoxelizeRequest& request, ResultSink& sink,
             std::function<absl::Status(const ResultHeader&)> may_begin)
      : request_(request), sink_(sink), may_begin_(std::move(may_begin)) {}

  // The next message. Errors: those of `may_begin` and of the sink.
  absl::Status Take(grpc::ByteBuffer& message);

  // After the last message. INTERNAL if it was not the summary.
  absl::Status Check() const;
  const v1::Summary& summary() const { return summary_; }

 private:
  absl::Status Begin(const v1::ResultHeader& message);
  absl::Status Write(const v1::ResultPiece& piece);

  const VoxelizeRequest& request_;
  ResultSink& sink_;
  const std::function<absl::Status(const ResultHeader&)> may_begin_;
  v1::Summary summary_;
  bool complete_ = false;
};

}  // namespace voxelpipe
