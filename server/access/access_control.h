// Access control: authenticates callers, checks their role and their quotas.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "access/quotas.h"
#include "access/tokens.h"
#include "observe/metrics.h"

namespace voxelpipe {

// A call's way through the door; its share of the client's quota goes back when it does. Movable, not copyable.
class Admitted {
 public:
  Admitted() = default;  // of somebody without a name, who may do everything
  Admitted(Admitted&&) = default;
  Admitted& operator=(Admitted&&) = delete;
  ~Admitted() {
    if (quota_) quota_->End(answered_);
  }

  const std::string& name() const { return name_; }  // of the token's client, or the certificate's; else empty
  Role role() const { return role_; }
  // `bytes` of a mesh came. Errors: RESOURCE_EXHAUSTED with RetryInfo and QuotaFailure.
  absl::Status TakeBytes(uint64_t bytes, QuotaClock::time_point now = QuotaClock::now());
  // A job came that would be a call of its own if it were not one of many on a stream. Errors as those of TakeBytes.
  absl::Status TakeCall(QuotaClock::time_point now = QuotaClock::now());
  // The call is answered, though it has not ended. Once.
  void Answered() {
    if (quota_ && !std::exchange(answered_, true)) quota_->Answered();
  }

 private:
  friend class AccessControl;
  std::string name_;
  Role role_ = Role::kAdmin;
  std::shared_ptr<Quota> quota_;
  bool answered_ = false;
  Metrics* metrics_ = nullptr;
};

// Thread-safe. Must not be destroyed before those whom it admitted.
class AccessControl {
 public:
  // `token_file` empty: every caller may do everything. `open_health`: health checks need no token. Errors: those of
  // TokenTable::Read.
  static absl::StatusOr<std::unique_ptr<AccessControl>> Create(const std::string& token_file, bool open_health,
                                                               Metrics& metrics);

  // In: the `authorization` metadata of the call, and the name in its client's certificate, empty where that does not
  // count. A token goes before a certificate. Without a token file everybody is admitted, one with a certificate as a
  // user of that name. Errors, counted: UNAUTHENTICATED without a token or with one that is not known,
  // PERMISSION_DENIED where the role may not make this call, RESOURCE_EXHAUSTED (RetryInfo, QuotaFailure) beyond the
  // quota. `who`, if given: becomes the caller's name as far as it is known, also of one that is refused.
  absl::StatusOr<Admitted> Admit(std::optional<std::string_view> authorization, Rpc rpc,
                                 const std::string& certificate = "", QuotaClock::time_point now = QuotaClock::now(),
                                 std::string* who = nullptr);

  // Reads the token file again. Clients keep what they have used; calls in progress go on. Errors: those of
  // TokenTable::Read, and then the old table stays.
  absl::Status Reload();
  // The same if the file has changed since it was read.
  void ReloadIfChanged();

 private:
  AccessControl(std::string token_file, bool open_health, Metrics& metrics);
  void Install(TokenTable table);

  const std::string token_file_;
  const bool open_health_;
  Metrics& metrics_;
  std::mutex mutex_;
  std::shared_ptr<const TokenTable> table_;  // null: no tokens are asked for
  std::map<std::string, std::shared_ptr<Quota>> quotas_;
  std::string stamp_;  // of the file that was read last, well or not
};

}  // namespace voxelpipe
