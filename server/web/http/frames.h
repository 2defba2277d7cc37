// The bytes of gRPC-Web: frames of requests and responses, trailers, time-outs. Pure functions.
//
// Source: gRPC, "PROTOCOL-WEB.md" (2016 to 2023) and "PROTOCOL-HTTP2.md": Length-Prefixed-Message, Timeout,
// Percent-Encoded.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <grpcpp/support/status.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe {

// A frame is a byte of flags, four bytes with the length of the message (big endian), and the message.
inline constexpr size_t kFrameHeadBytes = 5;
using FrameHead = std::array<uint8_t, kFrameHeadBytes>;

// Keys in lower case with their values, in order.
using WebMetadata = std::vector<std::pair<std::string, std::string>>;

// In: the first bytes of a request's body and the size of all of it. OK if the body is exactly one message that is not
// compressed. Errors: INVALID_ARGUMENT for a truncated or second frame, UNIMPLEMENTED for a compressed one.
absl::Status CheckRequestFrame(std::string_view head, uint64_t body_bytes);

// The head of a message's frame. `bytes` below 2^32.
FrameHead HeadOfMessage(uint64_t bytes);

// The last frame of a response: the status, its details and further trailers, as lines of HTTP/1.
std::string TrailerFrame(const grpc::Status& status, const WebMetadata& trailers = {});

// A binary value of a header, as gRPC writes it: base64 without padding.
std::string BinaryValue(std::string_view bytes);

// Every byte other than printable ASCII, and '%', becomes %XX.
std::string PercentEncoded(std::string_view text);

// In: the value of `grpc-timeout`, 1 to 8 digits and a unit: H, M, S, m, u or n. INVALID_ARGUMENT for anything else.
absl::StatusOr<std::chrono::nanoseconds> ParseTimeout(std::string_view text);

}  // namespace voxelpipe
