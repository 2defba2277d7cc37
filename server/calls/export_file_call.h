// One ExportFile call: one message in, then the job, which writes a file, then the file.
#pragma once

#include <memory>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/result_call.h"
#include "export/exported_file.h"

namespace voxelpipe {

// Writing the file is the last stage of the job; the file is sent when it is complete.
class ExportFileCall final : public grpc::ServerWriteReactor<grpc::ByteBuffer>, private ResultCall {
 public:
  // The reactor of a new call. `state` must outlive it; `request` is consumed immediately.
  static ExportFileCall* Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                                grpc::ByteBuffer& request);

  void OnWriteDone(bool ok) override { WriteDone(ok); }
  void OnCancel() override { Cancelled(); }
  void OnDone() override { Ended(); }
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  ExportFileCall(ServiceState& state, grpc::CallbackServerContext& server_context);

  absl::Status TakeMessage(grpc::ByteBuffer& message);

  std::shared_ptr<ReplyStream> ReplyOfExport(const JobOutcome& outcome, bool cached) override;
  bool sends_progress() const override { return false; }
  void StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) override;
  void StartLastMessage(const grpc::ByteBuffer* message) override;
  void FinishCall(const grpc::Status& status) override { Finish(status); }

  std::shared_ptr<ExportedFile> file_;
};

}  // namespace voxelpipe
