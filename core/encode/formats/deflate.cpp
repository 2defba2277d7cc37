#include "encode/formats/deflate.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <new>

#include "encode/formats/bytes.h"
#include "job/job_work.h"

namespace voxelpipe {

struct DeflatePart::State {
  z_stream stream{};
  std::array<uint8_t, 1 << 16> buffer;
};

absl::Status DeflateBlock(std::span<const uint8_t> bytes, const JobContext* job,
                          const std::function<absl::Status(std::span<const uint8_t>)>& out) {
  constexpr size_t kMaxInput = size_t{1} << 30;  // zlib counts in 32 bits
  z_stream stream{};
  if (deflateInit(&stream, kDeflateLevel) != Z_OK) throw std::bad_alloc();
  const std::unique_ptr<z_stream, int (*)(z_stream*)> end(&stream, &deflateEnd);
  // Small, so that even runs, which become a thousandth, let the job be looked at.
  std::vector<uint8_t> buffer(16 << 10);
  for (int code = Z_OK; code != Z_STREAM_END;) {
    if (absl::Status s = CheckJob(job); !s.ok()) return s;
    if (stream.avail_in == 0) {
      const std::span<const uint8_t> piece = bytes.first(std::min(kMaxInput, bytes.size()));
      stream.next_in = const_cast<uint8_t*>(piece.data());  // zlib does not write there
      stream.avail_in = uInt(piece.size());
      bytes = bytes.subspan(piece.size());
    }
    stream.next_out = buffer.data();
    stream.avail_out = uInt(buffer.size());
    code = deflate(&stream, bytes.empty() ? Z_FINISH : Z_NO_FLUSH);
    const size_t made = buffer.size() - stream.avail_out;
    if (made == 0) continue;
    if (absl::Status s = out({buffer.data(), made}); !s.ok()) return s;
  }
  return absl::OkStatus();
}

uint64_t ZlibBlockBytes(uint64_t bytes) {
  return compressBound(uLong(bytes)) + kDeflateBytes;
}

absl::StatusOr<std::vector<uint8_t>> ZlibBlock(std::span<const uint8_t> bytes, const JobContext* job) {
  std::vector<uint8_t> compressed;
  compressed.reserve(compressBound(uLong(bytes.size())));
  const absl::Status s = DeflateBlock(bytes, job, [&](std::span<const uint8_t> piece) {
    compressed.insert(compressed.end(), piece.begin(), piece.end());
    return absl::OkStatus();
  });
  if (!s.ok()) return s;
  return compressed;
}

DeflatePart::DeflatePart(const JobContext* job) : state_(std::make_unique<State>()), job_(job) {
  constexpr int kRawWindow = -15, kMemory = 8;  // zlib's default sizes; negative: without a header
  if (deflateInit2(&state_->stream, kDeflateLevel, Z_DEFLATED, kRawWindow, kMemory, Z_DEFAULT_STRATEGY) != Z_OK) {
    throw std::bad_alloc();
  }
}

DeflatePart::DeflatePart(DeflatePart&&) noexcept = default;

DeflatePart::~DeflatePart() {
  if (state_ != nullptr) deflateEnd(&state_->stream);
}

absl::Status DeflatePart::Run(int flush, const Output& out) {
  z_stream& stream = state_->stream;
  do {
    stream.next_out = state_->buffer.data();
    stream.avail_out = uInt(state_->buffer.size());
    deflate(&stream, flush);
    const size_t made = state_->buffer.size() - stream.avail_out;
    if (made == 0) continue;
    if (absl::Status s = out({state_->buffer.data(), made}); !s.ok()) return s;
  } while (stream.avail_out == 0);
  return absl::OkStatus();
}

absl::Status DeflatePart::Write(std::span<const uint8_t> bytes, const Output& out) {
  constexpr size_t kMaxPiece = 1 << 20;  // between two looks at the job
  while (!bytes.empty()) {
    if (absl::Status s = CheckJob(job_); !s.ok()) return s;
    const std::span<const uint8_t> piece = bytes.first(std::min(kMaxPiece, bytes.size()));
    crc_ = uint32_t(crc32_z(crc_, piece.data(), piece.size()));
    bytes_ += piece.size();
    state_->stream.next_in = const_cast<uint8_t*>(piece.data());  // zlib does not write there
    state_->stream.avail_in = uInt(piece.size());
    if (absl::Status s = Run(Z_NO_FLUSH, out); !s.ok()) return s;
    bytes = bytes.subspan(piece.size());
  }
  return absl::OkStatus();
}

absl::Status DeflatePart::Finish(const Output& out) {
  return Run(Z_SYNC_FLUSH, out);
}

std::string GzipHeader() {
  // No name, no time, so that equal results are equal files; the system is unknown.
  return std::string("\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\xff", 10);
}

std::string GzipEnd(const std::vector<DeflatePart>& parts) {
  uint32_t crc = 0;
  uint64_t bytes = 0;
  for (const DeflatePart& part : parts) {
    crc = uint32_t(crc32_combine64(crc, part.crc(), off64_t(part.bytes())));
    bytes += part.bytes();
  }
  Bytes end;
  end.Put(uint8_t{3}).Put(uint8_t{0});  // an empty last block
  end.Put(crc).Put(uint32_t(bytes));    // modulo 2^32, as RFC 1952 has it
  return end.text();
}

}  // namespace voxelpipe
