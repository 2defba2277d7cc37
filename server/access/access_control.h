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

// An admitted call; the destructor returns its share of the client's quota. Movable, not copyable.
class Admitted {
 public:
  Admitted() = default;  // an anonymous caller, without restrictions
  Admitted(Admitted&&) = default;
  Admitted& operator=(Admitted&&) = delete;
  ~Admitted() {
    if (quota_) quota_->End(answered_);
  }

  const std::string& name() const { return name_; }  // the client of the token or the certificate; otherwise empty
  Role role() const { return role_; }
  // Charges `bytes` of a mesh. Errors: RESOURCE_EXHAUSTED with RetryInfo and QuotaFailure.
  absl::Status TakeBytes(uint64_t bytes, QuotaClock::time_point now = QuotaClock::now());
  // Charges a job of a stream like a call of its own. Errors as in TakeBytes.
  absl::Status TakeCall(QuotaClock::time_point now = QuotaClock::now());
  // The call is answered but has not ended. Call once.
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

// Thread-safe. Must outlive the calls that it admitted.
class AccessControl {
 public:
  // `token_file` empty: every caller may do everything. `open_health`: health checks need no token. Errors: those of
  // TokenTable::Read.
  static absl::StatusOr<std::unique_ptr<AccessControl>> Create(const std::string& token_file, bool open_health,
                                                               Metrics& metrics);

  // In: the `authorization` metadata of the call, and the name in its client's certificate, empty if certificates do
  // not name clients. A token takes precedence over a certificate. Without a token file every caller is admitted, one
  // with a certificate as a user of that name. Errors, counted: UNAUTHENTICATED without a token or with an unknown one,
  // PERMISSION_DENIED if the role may not make this call, RESOURCE_EXHAUSTED (RetryInfo, QuotaFailure) beyond the
  // quota. `who`, if given, receives the caller's name if known, also for a refused call.
  absl::StatusOr<Admitted> Admit(std::optional<std::string_view> authorization, Rpc rpc,
                                 const std::string& certificate = "", QuotaClock::time_point now = QuotaClock::now(),
                                 std::string* who = nullptr);
  // What Admit would answer now, without a share of the quota. A refused caller makes no call after this one, so the
  // refusal is counted here.
  absl::Status Check(std::optional<std::string_view> authorization, Rpc rpc, const std::string& certificate = "",
                     QuotaClock::time_point now = QuotaClock::now(), std::string* who = nullptr);

  // Reads the token file again. Clients' quota state is kept; calls in progress continue. Errors: those of
  // TokenTable::Read; then the old table stays.
  absl::Status Reload();
  // The same if the file has changed since it was read.
  void ReloadIfChanged();

 private:
  AccessControl(std::string token_file, bool open_health, Metrics& metrics);
  void Install(TokenTable table);
  // Admit without a share of the quota. Out: that quota, null if there is none.
  absl::StatusOr<Admitted> Identify(std::optional<std::string_view> authorization, Rpc rpc,
                                    const std::string& certificate, std::string* who, std::shared_ptr<Quota>& quota);

  const std::string token_file_;
  const bool open_health_;
  Metrics& metrics_;
  std::mutex mutex_;
  std::shared_ptr<const TokenTable> table_;  // null: no tokens are required
  std::map<std::string, std::shared_ptr<Quota>> quotas_;
  std::string stamp_;  // of the file that was read last, valid or not
};

}  // namespace voxelpipe
