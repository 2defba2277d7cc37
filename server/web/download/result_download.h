// The answer of POST /file?format=NAME: a result as a file of an output format.
#pragma once

#include <memory>
#include <string>

#include <grpcpp/support/status.h>
#include <microhttpd.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "export/exported_file.h"
#include "web/http/request_body.h"
#include "web/http/web_context.h"

namespace voxelpipe {

// The body is a VoxelizeRequest without compression. Its Voxelize call runs like any other; its job hands the result to
// the writer of the format (export/file_export.h), which makes the file in a folder of its own below the system's
// folder for temporary files. The response begins when the file is complete; its headers hold the summary of the call
// and the warnings. On the connection's thread, which only waits.
class ResultDownload {
 public:
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
  std::shared_ptr<ExportedFile> exported_;  // until the response is sent
};

}  // namespace voxelpipe
