// The answer of POST /file?format=NAME: a result as a file of an output format.
#pragma once

#include <string>

#include <grpcpp/support/status.h>
#include <microhttpd.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "schedule/byte_budget.h"
#include "web/http/request_body.h"
#include "web/http/web_context.h"

namespace voxelpipe {

// The body is a VoxelizeMeshRequest without compression. Its call runs like any other; its result goes to the writer of
// the format (encode/format_registry.h), which makes the file in a folder of its own below the system's folder for
// temporary files. The response begins when the file is complete. Several files of a result (.raw with its description,
// a file a target, a directory) become one .zip. On the connection's thread.
class ResultDownload {
 public:
  // At the same time; further requests get RESOURCE_EXHAUSTED with RetryInfo.
  static constexpr int kMaxRuns = 8;

  // `web` must outlive the object, and the object the response.
  explicit ResultDownload(WebContext& web);
  ~ResultDownload();
  ResultDownload(const ResultDownload&) = delete;
  ResultDownload& operator=(const ResultDownload&) = delete;

  // Runs the call, makes the file, and queues it. Errors are texts with the gRPC status in the headers.
  MHD_Result Answer(MHD_Connection* connection, RequestBody& body, const std::string& allowed);

 private:
  struct File;
  absl::StatusOr<File> Make(MHD_Connection* connection, RequestBody& body);

  WebContext& web_;
  BudgetShare share_;  // the bytes of the file
};

}  // namespace voxelpipe
