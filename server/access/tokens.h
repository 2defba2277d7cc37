// Who may call: the clients of a token file.
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
  kUser,     // and all work; deletes the meshes that it uploaded itself
  kAdmin,    // and the meshes of others
};
const char* RoleName(Role role);
// True if the role may make the call at all.
bool MayCall(Role role, Rpc rpc);

// What one client may take. 0: no limit.
struct QuotaLimits {
  double calls_per_second = 0;
  double burst_calls = 0;  // calls that may come at once after a pause; 0: those of one second, at least 1
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
//   {"clients": [{"name": "render-farm", "role": "user", "token_sha256": "<64 hexadecimal digits>", "calls_per_second": 50, ...}]}
// name: 1 to 64 letters, digits, '.', '_', '-', unique. role: "monitor", "user", "admin". Either token_sha256 (the
// SHA-256 of the token; what `printf %s TOKEN | sha256sum` prints) or token itself (16 to 512 printable characters),
// each a string or a list of strings, so that tokens can be changed one after the other; instead of them or beside them
// `certificate`, names that the client's certificate may have (access/certificate_name.h). The rest are those of
// QuotaLimits. Anything else in it is an error.
class TokenTable {
 public:
  // Errors: INVALID_ARGUMENT naming the client and the key at fault; never a token.
  static absl::StatusOr<TokenTable> Parse(std::string_view json);
  // The same from a file of at most 16 MiB; NOT_FOUND where it cannot be read.
  static absl::StatusOr<TokenTable> Read(const std::string& path);

  // The client that the token belongs to, or null. Takes the same time whatever the token.
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
