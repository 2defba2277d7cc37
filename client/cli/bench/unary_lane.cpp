// VoxelizeWhole calls over one connection, with requests serialized in advance.
#include <grpcpp/impl/codegen/proto_utils.h>

#include "bench/answer.h"
#include "bench/single_calls.h"

namespace voxelpipe::cli {
namespace {

constexpr char kMethod[] = "/voxelpipe.v1.VoxelizationService/VoxelizeWhole";

// Its address is the tag of both its events, one of which is outstanding at a time: the response, or the end of a
// pause.
struct Unary : SingleCall {
  std::unique_ptr<grpc::GenericClientAsyncResponseReader> reader;
  bool paused = false;
};

class UnaryLane final : public SingleCalls<Unary> {
 public:
  UnaryLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) : SingleCalls(std::move(channel), run) { Serve(); }
  ~UnaryLane() override { Join(); }

 private:
  void Launch(Unary& call) override {
    call.reader = stub_.PrepareUnaryCall(&*call.context, kMethod, run_.NextVariant().front(), &queue_);
    call.reader->StartCall();
    call.reader->Finish(&call.buffer, &call.status, &call);
  }

  void Handle(void* tag, bool) override {
    Unary& call = *static_cast<Unary*>(tag);
    if (std::exchange(call.paused, false)) return Again(call);
    Outcome outcome;
    outcome.code = absl::StatusCode(int(call.status.error_code()));
    if (call.status.ok()) {
      Answer answer;
      outcome.code = TakeAnswer(call, answer).code();
      if (outcome.code == absl::StatusCode::kOk) answer.Fill(run_.expected_hash, outcome);
    }
    call.reader.reset();  // owned by the call, which the next context releases
    Complete(call, outcome);
  }

  void* PauseTag(Unary& call) override {
    call.paused = true;
    return &call;
  }

  absl::Status TakeAnswer(Unary& call, Answer& answer) {
    answer.CountReceived(call.buffer.Length());
    if (!grpc::SerializationTraits<v1::VoxelizeWholeResponse>::Deserialize(&call.buffer, &message_).ok()) {
      return absl::DataLossError("the server's message cannot be read");
    }
    return answer.Take(*message_.mutable_result());
  }

  v1::VoxelizeWholeResponse message_;  // reused, so that its memory is allocated once
};

}  // namespace

std::unique_ptr<Lane> MakeUnaryLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run) {
  return std::make_unique<UnaryLane>(std::move(channel), run);
}

}  // namespace voxelpipe::cli
