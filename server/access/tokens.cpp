#include "access/tokens.h"

#include <openssl/crypto.h>
#include <openssl/sha.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <utility>

#include <nlohmann/json.hpp>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "access/certificate_name.h"
#include "observe/trace.h"

namespace voxelpipe {
namespace {

using Json = nlohmann::json;
using Digest = std::array<uint8_t, SHA256_DIGEST_LENGTH>;

constexpr size_t kMaxFileBytes = 16 << 20;
constexpr size_t kMinTokenBytes = 16, kMaxTokenBytes = 512;

Digest Sha256(std::string_view text) {
  Digest digest{};
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data());
  return digest;
}

absl::Status Wrong(std::string_view where, std::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(std::string(where), ": ", std::string(what)));
}

absl::StatusOr<Digest> FromHex(const std::string& where, const std::string& hex) {
  Digest digest{};
  if (hex.size() != 2 * digest.size() ||
      !std::all_of(hex.begin(), hex.end(), [](unsigned char c) { return std::isxdigit(c) != 0; })) {
    return Wrong(where, "needs 64 hexadecimal digits");
  }
  const std::string bytes = absl::HexStringToBytes(hex);
  std::copy(bytes.begin(), bytes.end(), digest.begin());
  return digest;
}

absl::StatusOr<Digest> FromToken(const std::string& where, const std::string& token) {
  if (token.size() < kMinTokenBytes || token.size() > kMaxTokenBytes ||
      !std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c <= '~'; })) {
    return Wrong(where, "needs 16 to 512 printable characters without spaces");
  }
  return Sha256(token);
}

// A string or a list of strings.
absl::StatusOr<std::vector<std::string>> Strings(const std::string& where, const Json& value) {
  std::vector<std::string> all;
  for (const Json& one : value.is_array() ? value : Json::array({value})) {
    if (!one.is_string()) return Wrong(where, "needs a string or a list of strings");
    all.push_back(one.get<std::string>());
  }
  return all;
}

template <typename Number>
absl::Status ReadLimit(const std::string& where, const Json& value, Number& out) {
  constexpr double kMaxNumber = 1e15;
  const bool whole = value.is_number_unsigned();
  if (!(std::is_floating_point_v<Number> ? value.is_number() : whole) || value.get<double>() < 0 ||
      value.get<double>() > std::min(kMaxNumber, double(std::numeric_limits<Number>::max()))) {
    return Wrong(where, "needs a number that is not negative");
  }
  out = value.get<Number>();
  return absl::OkStatus();
}

absl::Status ReadRole(const std::string& where, const Json& value, Role& out) {
  for (const Role role : {Role::kMonitor, Role::kUser, Role::kAdmin}) {
    if (value.is_string() && value.get<std::string>() == RoleName(role)) {
      out = role;
      return absl::OkStatus();
    }
  }
  return Wrong(where, "needs to be monitor, user or admin");
}

// One client, the digests of its tokens, and the names of its certificates.
absl::Status ReadClient(const std::string& place, const Json& object, TokenClient& client, std::vector<Digest>& digests,
                        std::vector<std::string>& certificates) {
  if (!object.is_object()) return Wrong(place, "needs to be an object");
  bool has_role = false;
  for (const auto& [key, value] : object.items()) {
    const std::string where = absl::StrCat(place, ".", IsRequestId(key) ? key : "?");
    absl::Status status;
    if (key == "name") {
      client.name = value.is_string() ? value.get<std::string>() : "";
    } else if (key == "role") {
      status = ReadRole(where, value, client.role);
      has_role = true;
    } else if (key == "token" || key == "token_sha256") {
      const absl::StatusOr<std::vector<std::string>> texts = Strings(where, value);
      if (!texts.ok()) return texts.status();
      for (const std::string& text : *texts) {
        const absl::StatusOr<Digest> digest = key == "token" ? FromToken(where, text) : FromHex(where, text);
        if (!digest.ok()) return digest.status();
        digests.push_back(*digest);
      }
    } else if (key == "certificate") {
      absl::StatusOr<std::vector<std::string>> names = Strings(where, value);
      if (!names.ok()) return names.status();
      for (std::string& name : *names) {
        if (!IsCertificateName(name)) return Wrong(where, "needs 1 to 128 letters, digits and . _ - : / @");
        certificates.push_back(std::move(name));
      }
    } else if (key == "calls_per_second") {
      status = ReadLimit(where, value, client.limits.calls_per_second);
    } else if (key == "burst_calls") {
      status = ReadLimit(where, value, client.limits.burst_calls);
    } else if (key == "calls_at_once") {
      status = ReadLimit(where, value, client.limits.calls_at_once);
    } else if (key == "bytes_per_second") {
      status = ReadLimit(where, value, client.limits.bytes_per_second);
    } else if (key == "burst_bytes") {
      status = ReadLimit(where, value, client.limits.burst_bytes);
    } else {
      return Wrong(where, "is not known");
    }
    if (!status.ok()) return status;
  }
  if (!IsRequestId(client.name)) return Wrong(place + ".name", "needs 1 to 64 letters, digits, '.', '_' or '-'");
  if (!has_role) return Wrong(place + ".role", "is missing");
  if (digests.empty() && certificates.empty()) return Wrong(place + ".token_sha256", "is missing");
  const QuotaLimits& limits = client.limits;
  if (limits.burst_calls > 0 && limits.calls_per_second == 0) {
    return Wrong(place + ".burst_calls", "has no effect without calls_per_second");
  }
  if (limits.burst_bytes > 0 && limits.bytes_per_second == 0) {
    return Wrong(place + ".burst_bytes", "has no effect without bytes_per_second");
  }
  return absl::OkStatus();
}

}  // namespace

const char* RoleName(Role role) {
  switch (role) {
    case Role::kMonitor: return "monitor";
    case Role::kUser: return "user";
    case Role::kAdmin: return "admin";
  }
  return "?";
}

bool MayCall(Role role, Rpc rpc) {
  switch (rpc) {
    case Rpc::kListShaders:
    case Rpc::kGetServerInfo:
    case Rpc::kHealthCheck:
    case Rpc::kHealthWatch: return true;
    default: return role != Role::kMonitor;
  }
}

absl::StatusOr<TokenTable> TokenTable::Parse(std::string_view json) {
  const Json root = Json::parse(json, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded()) return absl::InvalidArgumentError("is not JSON");
  if (!root.is_object() || root.size() != 1 || !root.contains("clients") || !root["clients"].is_array()) {
    return absl::InvalidArgumentError("needs to be an object with one list, clients");
  }
  TokenTable table;
  std::set<std::string> names;
  std::set<Digest> known;
  for (const Json& object : root["clients"]) {
    const std::string place = absl::StrCat("clients[", table.clients_.size(), "]");
    TokenClient client;
    std::vector<Digest> digests;
    std::vector<std::string> certificates;
    if (absl::Status status = ReadClient(place, object, client, digests, certificates); !status.ok()) return status;
    if (!names.insert(client.name).second) return Wrong(place + ".name", "is given twice: " + client.name);
    for (const Digest& digest : digests) {
      if (!known.insert(digest).second) return Wrong(place, "has a token that is given twice");
      table.entries_.push_back({digest, table.clients_.size()});
    }
    for (const std::string& name : certificates) {
      if (!table.certificates_.emplace(name, table.clients_.size()).second) {
        return Wrong(place, "has a certificate that is given twice");
      }
    }
    table.clients_.push_back(std::move(client));
  }
  return table;
}

absl::StatusOr<TokenTable> TokenTable::Read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::NotFoundError(absl::StrCat(path, ": cannot be read"));
  std::string text(kMaxFileBytes + 1, '\0');
  file.read(text.data(), std::streamsize(text.size()));
  text.resize(size_t(file.gcount()));
  if (file.bad()) return absl::NotFoundError(absl::StrCat(path, ": cannot be read"));
  if (text.size() > kMaxFileBytes) return Wrong(path, "is larger than 16 MiB");
  absl::StatusOr<TokenTable> table = Parse(text);
  OPENSSL_cleanse(text.data(), text.size());
  if (!table.ok()) return Wrong(path, {table.status().message().data(), table.status().message().size()});
  return table;
}

const TokenClient* TokenTable::Find(std::string_view token) const {
  const Digest digest = Sha256(token);
  const TokenClient* found = nullptr;
  for (const Entry& entry : entries_) {  // constant time: does not stop at a match
    if (CRYPTO_memcmp(digest.data(), entry.sha256.data(), digest.size()) == 0) found = &clients_[entry.client];
  }
  return found;
}

const TokenClient* TokenTable::FindCertificate(const std::string& name) const {
  const auto found = certificates_.find(name);
  return found == certificates_.end() ? nullptr : &clients_[found->second];
}

}  // namespace voxelpipe
