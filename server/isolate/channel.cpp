#include "isolate/channel.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr uint32_t kMagic = 0x76784c31;
// Below this size a message over the socket is faster than shared memory. Unix sockets hold about 200 KiB.
constexpr uint64_t kMaxInline = 48 << 10;

struct Header {
  uint32_t magic, kind;
  uint64_t number;
  uint64_t text_bytes, bulk_bytes;
  uint64_t in_region;  // 0 or 1
  uint64_t unused[3];  // padding: aligns the bytes after the header like bulk
};
static_assert(sizeof(Header) == kBulkAlignment);

uint64_t Aligned(uint64_t bytes) {
  return (bytes + kBulkAlignment - 1) / kBulkAlignment * kBulkAlignment;
}

}  // namespace

Channel::Channel(int socket, SharedRegion out, SharedRegion in, bool trusts)
    : socket_(socket),
      out_(std::move(out)),
      in_(std::move(in)),
      trusts_(trusts),
      buffer_((sizeof(Header) + kMaxInline) / sizeof(uint64_t)) {}

Channel::~Channel() {
  close(socket_);
}

absl::Status Channel::Send(MessageKind kind, uint64_t number, const ArchiveWriter& archive) {
  Header header{kMagic, uint32_t(kind), number, archive.text().size(), archive.bulk_bytes(), 0, {}};
  const uint64_t bulk_at = Aligned(header.text_bytes), bytes = bulk_at + header.bulk_bytes;
  header.in_region = bytes > kMaxInline ? 1 : 0;
  uint8_t* const packet = reinterpret_cast<uint8_t*>(buffer_.data());
  uint8_t* body = packet + sizeof header;
  if (header.in_region != 0) {
    absl::StatusOr<uint8_t*> mapped = out_.Map(bytes);
    if (!mapped.ok()) return mapped.status();
    body = *mapped;
  }
  std::memcpy(packet, &header, sizeof header);
  if (header.text_bytes > 0) std::memcpy(body, archive.text().data(), header.text_bytes);
  archive.CopyBulk(body + bulk_at);
  const uint64_t size = sizeof header + (header.in_region != 0 ? 0 : bytes);
  ssize_t sent = 0;
  do {
    sent = send(socket_, packet, size, MSG_NOSIGNAL);
  } while (sent < 0 && errno == EINTR);
  return uint64_t(sent) == size ? absl::OkStatus() : absl::UnavailableError("the other end is closed");
}

bool Channel::IsClosed() const {
  pollfd end{socket_, 0, 0};
  return poll(&end, 1, 0) == 1 && (end.revents & POLLHUP) != 0;
}

bool Channel::HasMessage() const {
  char first = 0;
  return recv(socket_, &first, sizeof first, MSG_PEEK | MSG_DONTWAIT) > 0;
}

absl::StatusOr<Message> Channel::Receive(std::chrono::milliseconds patience, uint64_t most_bytes) {
  pollfd ready{socket_, POLLIN, 0};
  const int polled = poll(&ready, 1, int(patience.count()));
  if (polled == 0 || (polled < 0 && errno == EINTR)) return absl::DeadlineExceededError("no message yet");
  const uint64_t room = buffer_.size() * sizeof(uint64_t);
  ssize_t got = 0;
  do {
    got = recv(socket_, buffer_.data(), room, MSG_TRUNC);
  } while (got < 0 && errno == EINTR);
  // A socket that is closed with an unread message tells the sender.
  if (got < 0 && errno == ECONNRESET)
    return absl::AbortedError("the other end is closed, and has not read the message");
  if (got <= 0) return absl::UnavailableError("the other end is closed");
  const absl::Status broken = absl::InternalError("an invalid message");
  Header header{};
  if (uint64_t(got) > room || uint64_t(got) < sizeof header) return broken;
  std::memcpy(&header, buffer_.data(), sizeof header);
  if (header.magic != kMagic || header.kind > uint32_t(MessageKind::kAnswer)) return broken;
  constexpr uint64_t kMaxBytes = SharedRegion::kBytes / 2;
  if (header.text_bytes > kMaxBytes || header.bulk_bytes > kMaxBytes - kBulkAlignment) return broken;
  const uint64_t bulk_at = Aligned(header.text_bytes), bytes = bulk_at + header.bulk_bytes;
  const uint8_t* body = reinterpret_cast<const uint8_t*>(buffer_.data()) + sizeof header;
  if (bytes > most_bytes) return absl::ResourceExhaustedError(absl::StrCat("a message of ", bytes, " bytes"));
  if (header.in_region != 0) {
    // Unwritten pages take no memory there, but would here.
    if (!trusts_ && bytes > in_.resident_bytes()) return broken;
    absl::StatusOr<uint8_t*> mapped = in_.Map(bytes);
    if (!mapped.ok()) return mapped.status();
    body = *mapped;
  } else if (bytes != uint64_t(got) - sizeof header) {
    return broken;
  }
  return Message{
      MessageKind(header.kind), header.number, {body, body + header.text_bytes}, {body + bulk_at, header.bulk_bytes}};
}

}  // namespace voxelpipe
