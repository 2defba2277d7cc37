// W3C trace context: where a call belongs in its caller's trace. https://www.w3.org/TR/trace-context/
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

// In: the value of `traceparent`, e.g. "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01". Nothing where it is
// not valid; of a version that is not known the parts that every version has.
std::optional<TraceContext> ParseTraceparent(std::string_view value);

// A request id that a caller may choose: 1 to 64 letters, digits, '.', '_' and '-'.
bool IsRequestId(std::string_view text);
// One of our own: unique over the processes of a cluster, and counting within one.
std::string MakeRequestId();

}  // namespace voxelpipe
