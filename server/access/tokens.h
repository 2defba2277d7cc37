// The clients of a token file.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "observe/metrics.h"

namespace voxelpipe {

enum class Role {
  kMonitor,  // health, server info, shaders
  kUser,     // also all jobs; deletes the meshes that it uploaded itself
  kAdmin,    // also deletes the meshes of others
};
const char* RoleName(Role role);
// True if the role may make the call.
bool MayCall(Role role, Rpc rpc);

// The limits of one client. 0: no limit.
struct QuotaLimits {
  double calls_per_second = 0;
  double burst_calls = 0;  // burst of calls after a pause; 0: those of one second, at least 1
  uint32_t calls_at_once = 0;
  uint64_t bytes_per_second = 0;  // of meshes that it sends
  uint64_t burst_bytes = 0;       // 0: those of one second

  bool operator==(const QuotaLimits&) const = default;
};

struct TokenClient {
  std::string name;
  Role role = Role::kUser;
  QuotaLimits limits;
};

// Immutable. The file is JSON:
//   {"clients": [{"name": "render-farm", "role": "user", "token_sha256": "<64 hexadecimal digits>",
//                 "calls_per_second": 50, ...}]}
// name: 1 to 64 letters, digits, '.', '_', '-', unique. role: "monitor", "user", "admin". Either token_sha256 (the
// SHA-256 of the token; what `printf %s TOKEN | sha256sum` prints) or token itself (16 to 512 printable characters),
// each a string or a list of strings, so that tokens can be rotated; instead or in addition `certificate`, names in the
// client's certificate (access/certificate_name.h). The other keys are those of QuotaLimits. Any other content is an
// error.
class TokenTable {
 public:
  // Errors: INVALID_ARGUMENT naming the client and the key at fault; never a token.
  static absl::StatusOr<TokenTable> Parse(std::string_view json);
  // The same from a file of at most 16 MiB; NOT_FOUND if it cannot be read.
  static absl::StatusOr<TokenTable> Read(const std::string& path);

  // The client of the token, or null. Constant time for all tokens.
  const TokenClient* Find(std::string_view token) const;
  // The client whose certificate has this name, or null.
  const TokenClient* FindCertificate(const std::string& name) const;
  const std::vector<TokenClient>& clients() const { return clients_; }

 private:
  struct Entry {
    std::array<uint8_t, 32> sha256;
    size_t client;
  };
  std::vector<TokenClient> clients_;
  std::vector<Entry> entries_;
  std::map<std::string, size_t> certificates_;
};

}  // namespace voxelpipe
