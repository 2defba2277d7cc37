// One ExportFile call: one message in, then the job, which writes a file, then the file.
#pragma once

#include <memory>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/voxelize_call.h"
#include "export/exported_file.h"

namespace voxelpipe {

// Writing the file is the last stage of the job; the file is sent when it is complete.
class ExportFileCall final : public VoxelizeCall {
 public:
  // As VoxelizeCall::Create.
  static VoxelizeCall* Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                              grpc::ByteBuffer& request);

 private:
  ExportFileCall(ServiceState& state, grpc::CallbackServerContext& server_context);

  absl::Status TakeMessage(grpc::ByteBuffer& bytes) override;
  std::shared_ptr<ReplyStream> ReplyOfExport(const JobOutcome& outcome, bool cached) override;
  bool sends_progress() const override { return false; }

  std::shared_ptr<ExportedFile> file_;
};

}  // namespace voxelpipe
