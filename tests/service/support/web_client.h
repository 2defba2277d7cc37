// HTTP/1.1 and gRPC-Web on a bare socket.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace voxelpipe::testing {

using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

// A response. Empty if the server closed the connection without one.
struct HttpReply {
  int code = 0;
  HttpHeaders headers;    // names in lower case
  std::string body;       // chunks put together
  bool complete = false;  // the body has its announced end

  std::string Header(const std::string& name) const;  // empty: absent
};

// A connection to "127.0.0.1:PORT", from "127.0.0.1" or another address of this machine.
class WebConnection {
 public:
  explicit WebConnection(const std::string& address, int receive_buffer_bytes = 0,
                         const std::string& from = "127.0.0.1");
  ~WebConnection();
  WebConnection(const WebConnection&) = delete;
  WebConnection& operator=(const WebConnection&) = delete;

  // False if the server has hung up.
  bool Send(std::string_view bytes) const;
  // The next bytes, at most 64 KiB. Empty at the end, or after kPatience.
  std::string Receive() const;
  // Reads until the server closes the connection.
  HttpReply ReadReply() const;
  // The address of this end, as gRPC writes it.
  std::string OwnAddress() const;

 private:
  int socket_;
};

// A request with its head. `headers` are added to Host (the address), and Content-Length if there is a body; a Host
// among them replaces that one.
std::string HttpRequest(const std::string& address, const std::string& method, const std::string& path,
                        const HttpHeaders& headers = {}, std::string_view body = "");
HttpReply Fetch(const std::string& address, const std::string& method, const std::string& path,
                const HttpHeaders& headers = {}, std::string_view body = "");

// gRPC-Web.
std::string WebFrame(std::string_view message);
// A whole call.
struct WebReplyOfCall {
  HttpReply http;
  std::vector<std::string> messages;
  int status = -1;       // of grpc-status; -1: there is none
  std::string trailers;  // as they came
};
WebReplyOfCall ParseWebReply(HttpReply http);
std::string WebMethod(const std::string& name);  // its path
// A call of a method, by its name, with one message.
WebReplyOfCall CallWeb(const std::string& address, const std::string& method, std::string_view message,
                       HttpHeaders headers = {});

}  // namespace voxelpipe::testing
