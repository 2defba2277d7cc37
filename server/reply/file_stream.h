// The messages of an exported file.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "export/exported_file.h"
#include "jobs/job.h"
#include "reply/reply_stream.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// Reads a file of this machine: blocks for a piece of it at a time.
class FileStream final : public ReplyStream {
 public:
  // `file`: complete. `outcome`: of its job. `cached`: for the summary.
  FileStream(std::shared_ptr<ExportedFile> file, const JobOutcome& outcome, bool cached, uint64_t piece_bytes);
  ~FileStream() override;

  grpc::ByteBuffer Next() override;
  absl::Status status() const override { return status_; }
  bool done() const override { return done_; }
  bool next_is_ready() const override { return !done_; }

  uint64_t bytes() const override { return offset_; }
  uint64_t sent_bytes() const override { return offset_; }

 private:
  const std::shared_ptr<ExportedFile> file_;  // its charge lives as long as this object
  const uint64_t piece_bytes_;
  v1::ExportSummary summary_;
  absl::Status status_;
  ExportedFile::Open open_;
  uint64_t offset_ = 0;
  bool begun_ = false, done_ = false;
};

}  // namespace voxelpipe
