// A client on a bare socket: it can send invalid data, and die between any two bytes.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace voxelpipe::testing {

inline constexpr char kVoxelizeMethod[] = "/voxelpipe.v1.VoxelizationService/Voxelize";
inline constexpr char kUploadMethod[] = "/voxelpipe.v1.VoxelizationService/VoxelizeUpload";

// The bytes of HTTP/2 (RFC 9113) and of gRPC's messages in it.
namespace http2 {

inline constexpr uint8_t kData = 0, kHeaders = 1, kResetStream = 3, kSettings = 4, kPing = 6, kGoAway = 7,
                         kWindowUpdate = 8, kContinuation = 9;
inline constexpr uint8_t kEndStream = 1, kAck = 1, kEndHeaders = 4;
inline constexpr size_t kFrameBytes = 16384;  // the largest payload that every peer accepts

std::string Frame(uint8_t type, uint8_t flags, uint32_t stream, std::string_view payload);
// Preface, settings, and a window so wide that the server never waits for this client's updates.
std::string Opening();
// One header block that calls a method, such as kVoxelizeMethod.
std::string Request(uint32_t stream, std::string_view path);
// A serialized message with its five-byte prefix, not compressed.
std::string Message(std::string_view serialized);
// Bytes as DATA frames, the last one with END_STREAM if `end`.
std::string Data(uint32_t stream, std::string_view bytes, bool end);

}  // namespace http2

// Not thread-safe. Every wait ends by kPatience.
class RawClient {
 public:
  // Connects to "127.0.0.1:PORT". `receive_buffer_bytes`: of the socket, 0 for the system's choice.
  static absl::StatusOr<std::unique_ptr<RawClient>> Connect(const std::string& address, int receive_buffer_bytes = 0);
  // Dies like a killed process: without a goodbye; unread data causes a reset.
  ~RawClient();
  RawClient(const RawClient&) = delete;
  RawClient& operator=(const RawClient&) = delete;

  // False if the server has hung up or reads nothing more within kPatience.
  bool Send(std::string_view bytes);
  // Reads until `bytes` more have come (any bytes: frames, settings), the server has hung up or the time is over. Out:
  // how many came.
  size_t Read(size_t bytes, std::chrono::milliseconds patience);
  // Reads and answers pings and settings until a DATA frame has come. False if the call or the connection ends before.
  bool ReadUntilData();
  // Reads until the server closes the connection. False if it does not within kPatience.
  bool ReadUntilHangUp(std::chrono::milliseconds patience);

  uint64_t bytes_read() const { return bytes_read_; }

 private:
  explicit RawClient(int socket) : socket_(socket) {}
  // At most 64 KiB more into received_. 0: hung up; -1: the time is over.
  long ReadSome(std::chrono::steady_clock::time_point deadline);
  // The type of the next whole frame, removed from received_.
  std::optional<uint8_t> NextFrame(std::string& payload, uint8_t& flags);

  const int socket_;
  std::string received_;  // not parsed yet
  uint64_t bytes_read_ = 0;
};

}  // namespace voxelpipe::testing
