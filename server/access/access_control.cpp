#include "access/access_control.h"

#include <sys/stat.h>

#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "observe/log.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr std::string_view kBearer = "bearer ";

// A stamp that changes if the file is written or replaced. A mounted secret is a link to another file after a change.
std::string StampOf(const std::string& path) {
  struct stat now {};
  if (stat(path.c_str(), &now) != 0) return "gone";
  return absl::StrCat(now.st_ino, " ", now.st_size, " ", now.st_mtim.tv_sec, ".", now.st_mtim.tv_nsec);
}

// The token of "Bearer TOKEN", empty for anything else.
std::string_view TokenOf(std::string_view authorization) {
  if (!absl::StartsWithIgnoreCase({authorization.data(), authorization.size()}, {kBearer.data(), kBearer.size()})) {
    return {};
  }
  return authorization.substr(kBearer.size());
}

absl::Status Refuse(const QuotaRefusal& refusal, const std::string& client, Metrics& metrics) {
  metrics.Refused(refusal.reason).Increment();
  const char* what = refusal.reason == Refusal::kQuotaRate    ? "calls a second"
                     : refusal.reason == Refusal::kQuotaCalls ? "calls at the same time"
                                                              : "bytes a second";
  return QuotaError(absl::StrCat("the quota of ", what, " is used up"), absl::StrCat("client:", client),
                    refusal.retry_after);
}

}  // namespace

absl::Status Admitted::TakeBytes(uint64_t bytes, QuotaClock::time_point now) {
  if (!quota_) return absl::OkStatus();
  const std::optional<QuotaRefusal> refusal = quota_->TakeBytes(bytes, now);
  return refusal ? Refuse(*refusal, name_, *metrics_) : absl::OkStatus();
}

absl::Status Admitted::TakeCall(QuotaClock::time_point now) {
  if (!quota_) return absl::OkStatus();
  const std::optional<QuotaRefusal> refusal = quota_->TakeCall(now);
  return refusal ? Refuse(*refusal, name_, *metrics_) : absl::OkStatus();
}

AccessControl::AccessControl(std::string token_file, bool open_health, Metrics& metrics)
    : token_file_(std::move(token_file)), open_health_(open_health), metrics_(metrics) {}

absl::StatusOr<std::unique_ptr<AccessControl>> AccessControl::Create(const std::string& token_file, bool open_health,
                                                                     Metrics& metrics) {
  std::unique_ptr<AccessControl> control(new AccessControl(token_file, open_health, metrics));
  if (token_file.empty()) return control;
  control->stamp_ = StampOf(token_file);
  absl::StatusOr<TokenTable> table = TokenTable::Read(token_file);
  if (!table.ok()) return table.status();
  control->Install(*std::move(table));
  return control;
}

void AccessControl::Install(TokenTable table) {
  const auto now = QuotaClock::now();
  const std::lock_guard lock(mutex_);
  std::map<std::string, std::shared_ptr<Quota>> quotas;
  for (const TokenClient& client : table.clients()) {
    const auto before = quotas_.find(client.name);
    if (before == quotas_.end()) {
      quotas[client.name] = std::make_shared<Quota>(client.limits);
    } else {
      before->second->SetLimits(client.limits, now);
      quotas[client.name] = before->second;
    }
  }
  quotas_ = std::move(quotas);
  table_ = std::make_shared<const TokenTable>(std::move(table));
}

absl::StatusOr<Admitted> AccessControl::Admit(std::optional<std::string_view> authorization, Rpc rpc,
                                              const std::string& certificate, QuotaClock::time_point now,
                                              std::string* who) {
  std::shared_ptr<Quota> quota;
  absl::StatusOr<Admitted> admitted = Identify(authorization, rpc, certificate, who, quota);
  if (!admitted.ok() || !quota) return admitted;
  if (const auto refusal = quota->Begin(now)) return Refuse(*refusal, admitted->name_, metrics_);
  admitted->quota_ = std::move(quota);
  return admitted;
}

absl::Status AccessControl::Check(std::optional<std::string_view> authorization, Rpc rpc,
                                  const std::string& certificate, QuotaClock::time_point now, std::string* who) {
  std::shared_ptr<Quota> quota;
  const absl::StatusOr<Admitted> admitted = Identify(authorization, rpc, certificate, who, quota);
  if (!admitted.ok() || !quota) return admitted.status();
  const std::optional<QuotaRefusal> refusal = quota->Check(now);
  return refusal ? Refuse(*refusal, admitted->name_, metrics_) : absl::OkStatus();
}

absl::StatusOr<Admitted> AccessControl::Identify(std::optional<std::string_view> authorization, Rpc rpc,
                                                 const std::string& certificate, std::string* who,
                                                 std::shared_ptr<Quota>& quota) {
  const bool health = rpc == Rpc::kHealthCheck || rpc == Rpc::kHealthWatch;
  if (health && open_health_) return Admitted();
  if (token_file_.empty()) {
    Admitted admitted;
    if (!certificate.empty()) {
      admitted.name_ = certificate;
      if (who != nullptr) *who = certificate;
      admitted.role_ = Role::kUser;
    }
    return admitted;
  }
  std::shared_ptr<const TokenTable> table;
  {
    const std::lock_guard lock(mutex_);
    table = table_;
  }
  const TokenClient* client = nullptr;
  if (authorization) {
    client = table->Find(TokenOf(*authorization));
  } else {
    if (!certificate.empty()) client = table->FindCertificate(certificate);
    if (client == nullptr) {
      metrics_.Refused(Refusal::kNoToken).Increment();
      return absl::UnauthenticatedError(
          certificate.empty() ? "a token is needed: authorization: Bearer TOKEN"
                              : absl::StrCat("a token is needed, authorization: Bearer TOKEN; the certificate's name ",
                                             certificate, " is not known here"));
    }
  }
  if (client == nullptr) {
    metrics_.Refused(Refusal::kBadToken).Increment();
    return absl::UnauthenticatedError("the token is unknown");
  }
  if (who != nullptr) *who = client->name;
  if (!MayCall(client->role, rpc)) {
    metrics_.Refused(Refusal::kRole).Increment();
    return absl::PermissionDeniedError(
        absl::StrCat("the role ", RoleName(client->role), " of ", client->name, " may not call ", RpcName(rpc)));
  }
  Admitted admitted;
  admitted.name_ = client->name;
  admitted.role_ = client->role;
  admitted.metrics_ = &metrics_;
  if (health) return admitted;  // a watch takes no quota
  const std::lock_guard lock(mutex_);
  const auto found = quotas_.find(client->name);
  if (found != quotas_.end()) quota = found->second;
  return admitted;
}

absl::Status AccessControl::Reload() {
  if (token_file_.empty()) return absl::OkStatus();
  const std::string stamp = StampOf(token_file_);
  absl::StatusOr<TokenTable> table = TokenTable::Read(token_file_);
  {
    const std::lock_guard lock(mutex_);
    stamp_ = stamp;
  }
  if (!table.ok()) {
    metrics_.reload_failures.Increment();
    LogMessage(LogLevel::kError, absl::StrCat("the tokens stay as they were: ", std::string(table.status().message())));
    return table.status();
  }
  const size_t clients = table->clients().size();
  Install(*std::move(table));
  metrics_.reloads.Increment();
  LogMessage(LogLevel::kInfo, absl::StrCat("tokens of ", clients, " clients read from ", token_file_));
  return absl::OkStatus();
}

void AccessControl::ReloadIfChanged() {
  if (token_file_.empty()) return;
  const std::string stamp = StampOf(token_file_);
  {
    const std::lock_guard lock(mutex_);
    if (stamp == stamp_) return;
  }
  Reload().IgnoreError();
}

}  // namespace voxelpipe
