#include "reply/file_stream.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>
#include <utility>

#include "base/checksum/crc32c.h"
#include "encode/atomic_file.h"
#include "reply/raw_message.h"
#include "reply/result_pieces.h"
#include "wire/response.h"

namespace voxelpipe {

FileStream::FileStream(std::shared_ptr<ExportedFile> file, const JobOutcome& outcome, bool cached, uint64_t piece_bytes)
    : file_(std::move(file)), piece_bytes_(piece_bytes) {
  WriteOutcome(outcome, *summary_.mutable_summary());
  WarningList warnings = outcome.result.stats.warnings;
  warnings.Append(file_->warnings);
  summary_.mutable_summary()->clear_warnings();
  WriteWarnings(warnings, *summary_.mutable_summary());
  summary_.mutable_summary()->set_cached(cached);
  absl::StatusOr<ExportedFile::Open> open = file_->Take();
  if (open.ok()) {
    open_ = *std::move(open);
  } else {
    status_ = open.status();
  }
}

FileStream::~FileStream() {
  if (open_.descriptor >= 0) close(open_.descriptor);
}

grpc::ByteBuffer FileStream::Next() {
  grpc::ByteBuffer message;
  if (!status_.ok()) return message;
  v1::FileChunk chunk;
  if (!std::exchange(begun_, true)) {
    chunk.mutable_file()->set_name(open_.name);
    chunk.mutable_file()->set_bytes(int64_t(open_.bytes));
  }
  std::string& data = *chunk.mutable_data();
  data.resize(size_t(std::min(piece_bytes_, open_.bytes - offset_)));
  for (size_t got = 0; got < data.size();) {
    const ssize_t read = pread(open_.descriptor, data.data() + got, data.size() - got, off_t(offset_ + got));
    if (read < 0 && errno == EINTR) continue;
    if (read <= 0) {
      status_ = WithoutPaths(OutputError(read < 0 ? errno : EIO, "cannot read a temporary file"));
      return message;
    }
    got += size_t(read);
  }
  offset_ += data.size();
  chunk.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(data.data()), data.size()}));
  done_ = offset_ == open_.bytes;
  if (done_) *chunk.mutable_summary() = std::move(summary_);
  WriteMessage(chunk, message);
  return message;
}

}  // namespace voxelpipe
