// W3C trace context: the position of a call in its caller's trace. https://www.w3.org/TR/trace-context/
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace voxelpipe {

struct TraceContext {
  std::string trace_id;  // 32 hexadecimal digits, not all 0
  std::string span_id;   // 16, of the caller's span, not all 0
  bool sampled = false;
};

// In: the value of `traceparent`, e.g. "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01". Empty if it is not
// valid; for an unknown version the parts that every version has.
std::optional<TraceContext> ParseTraceparent(std::string_view value);

// A request id that a caller may choose: 1 to 64 letters, digits, '.', '_' and '-'.
bool IsRequestId(std::string_view text);
// A generated id: unique over the processes of a cluster, with a counter within a process.
std::string MakeRequestId();

}  // namespace voxelpipe
