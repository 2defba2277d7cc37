// The messages of a result in memory.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include <grpcpp/support/byte_buffer.h>

#include "jobs/job.h"
#include "reply/reply_stream.h"
#include "reply/result_pieces.h"

namespace voxelpipe {

// Not thread-safe. Messages keep the outcome alive until gRPC has sent them, also after the end of this object.
class ResultStream final : public ReplyStream {
 public:
  // `request` lives as long as this object. `cached`: for the summary.
  ResultStream(std::shared_ptr<const JobOutcome> outcome, const VoxelizeRequest& request, const CallSettings& settings,
               const PieceOptions& options, ResponseCoder coder = {}, bool cached = false);

  // Sends the plan with the header. Before Next.
  void SetPlan(const Plan& plan) { plan_ = plan; }

  grpc::ByteBuffer Next() override;
  void CatchUp() override;
  bool done() const override { return part_ == Part::kEnd; }
  bool next_is_ready() const override { return !done() && pieces_.at_once(); }

  uint64_t bytes() const override { return pieces_.bytes(); }
  uint64_t sent_bytes() const override { return pieces_.sent_bytes(); }
  const JobOutcome& outcome() const { return *outcome_; }

 private:
  enum class Part { kHeader, kPieces, kEnd };

  const std::shared_ptr<const JobOutcome> outcome_;
  const std::vector<std::span<const uint8_t>> arrays_;
  std::optional<Plan> plan_;
  Part part_ = Part::kHeader;
  size_t array_ = 0;
  uint64_t offset_ = 0;
  std::span<const uint8_t> to_hash_;
  ResultPieces pieces_;
};

}  // namespace voxelpipe
