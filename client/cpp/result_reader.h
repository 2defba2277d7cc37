// Puts a streamed result together and checks it.
#pragma once

#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

struct evp_md_ctx_st;

namespace voxelpipe {

// Fed with header, pieces and summary as they come. Every error is DATA_LOSS saying what does not fit, but for
// RESOURCE_EXHAUSTED where this machine has no memory for the result. After an error the object is of no more use.
class ResultReader {
 public:
  // `request` must outlive the object.
  ResultReader(const VoxelizeRequest& request, uint64_t max_result_bytes);
  ~ResultReader();

  // Checks the announced grid and sizes against the request, then allocates the targets.
  absl::Status AddHeader(const v1::ResultHeader& header);
  // Checks target, offset, length and CRC32C, then copies the bytes to their place.
  absl::Status AddPiece(const v1::ResultPiece& piece);
  // Checks that everything came and that its SHA-256 is the announced one.
  absl::Status AddSummary(const v1::Summary& summary);

  // In [0, 1] once the header is there.
  double fraction() const { return total_bytes_ == 0 ? 1 : double(received_bytes_) / double(total_bytes_); }

  // The result. DATA_LOSS if the summary has not come.
  absl::StatusOr<RemoteResult> Take();

 private:
  struct FreeDigest {
    void operator()(evp_md_ctx_st* context) const;
  };

  const VoxelizeRequest& request_;
  const uint64_t max_result_bytes_;
  bool has_header_ = false, has_summary_ = false;
  size_t target_ = 0;    // the one that the next byte belongs to
  uint64_t offset_ = 0;  // of the next byte in it
  uint64_t received_bytes_ = 0, total_bytes_ = 0;
  std::unique_ptr<evp_md_ctx_st, FreeDigest> digest_;
  RemoteResult out_;
};

}  // namespace voxelpipe
