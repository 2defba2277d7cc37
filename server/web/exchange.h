// One HTTP request and its answer.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <microhttpd.h>

#include "absl/status/status.h"
#include "web/download/result_download.h"
#include "web/http/bridge_call.h"
#include "web/http/request_body.h"
#include "web/http/web_context.h"

namespace voxelpipe {

// On its connection's thread.
class Exchange {
 public:
  // `path` without the query. `web` must outlive the object.
  Exchange(WebContext& web, std::string path, std::string method)
      : web_(web), path_(std::move(path)), method_(std::move(method)) {}

  // The head has arrived: answers it, or prepares for a body, if the caller may make this call. MHD_NO closes the
  // connection, here and below.
  MHD_Result Begin(MHD_Connection* connection);
  // A piece of the body.
  MHD_Result Take(std::string_view piece);
  // The whole body has arrived: answers.
  MHD_Result End(MHD_Connection* connection);

  // True if the request was answered although its body, or a part of it, is still to come.
  bool leaves_body() const { return leaves_body_; }

 private:
  // The answer to a request that must not go on; none if it may.
  std::optional<MHD_Result> Refuse(MHD_Connection* connection);
  // Decides everything that the head of a call can tell. Out: headers of the answer to a refused one.
  absl::Status CheckCall(MHD_Connection* connection, WebMetadata& headers);
  bool asks_for_file() const;

  WebContext& web_;
  const std::string path_, method_;
  std::string allowed_;  // the foreign origin that may read the response; empty: none
  bool leaves_body_ = false;
  std::optional<BridgeCall::Setup> call_;  // of a method
  std::unique_ptr<RequestBody> body_;
  std::unique_ptr<ResultDownload> download_;  // until its last byte is sent
};

}  // namespace voxelpipe
