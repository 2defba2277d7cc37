#include "calls/call_record.h"

#include <spdlog/spdlog.h>

#include "wire/text.h"

namespace voxelpipe {

void CallRecord::Log(const absl::Status& status) const {
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  const std::string code(absl::StatusCodeToString(status.code()));
  std::string error;
  if (!status.ok()) error = " error=\"" + CleanText({status.message().data(), status.message().size()}, 300) + "\"";
  spdlog::info("request={} method={} peer={} code={} ms={:.1f} in={} out={}{}{}", id, method, peer, code, ms, bytes_in,
               bytes_out, facts, error);
}

}  // namespace voxelpipe
