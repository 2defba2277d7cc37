#include "batch/server_pool.h"

#include <algorithm>

namespace voxelpipe::cli {
namespace {

constexpr std::chrono::milliseconds kFirstRest{250}, kLongestRest{30000};
constexpr std::chrono::milliseconds kShortestDelay{10};  // where a server returns a delay of 0: no busy loop

}  // namespace

std::optional<size_t> ServerPool::Take(TimePoint now) {
  const std::lock_guard lock(mutex_);
  std::optional<size_t> best;
  for (size_t k = 0; k < servers_.size(); ++k) {
    const size_t i = (next_ + k) % servers_.size();
    if (servers_[i].rests_until > now) continue;
    if (!best || servers_[i].jobs < servers_[*best].jobs) best = i;
  }
  if (best) {
    ++servers_[*best].jobs;
    next_ = *best + 1;
  }
  return best;
}

ServerPool::TimePoint ServerPool::NextFree() const {
  const std::lock_guard lock(mutex_);
  TimePoint first = TimePoint::max();
  for (const Server& server : servers_) first = std::min(first, server.rests_until);
  return first;
}

std::optional<ServerPool::TimePoint> ServerPool::GoneSince() const {
  const std::lock_guard lock(mutex_);
  TimePoint since = TimePoint::min();
  for (const Server& server : servers_) {
    if (!server.gone_since) return std::nullopt;
    since = std::max(since, *server.gone_since);
  }
  return since;
}

void ServerPool::Answered(size_t server) {
  const std::lock_guard lock(mutex_);
  servers_[server].losses = 0;
  servers_[server].gone_since.reset();
}

void ServerPool::Return(size_t server) {
  const std::lock_guard lock(mutex_);
  --servers_[server].jobs;
}

void ServerPool::Lost(size_t server, TimePoint now) {
  const std::lock_guard lock(mutex_);
  servers_[server].gone_since.reset();
  Rest(server, now);
}

void ServerPool::Unreachable(size_t server, TimePoint now) {
  const std::lock_guard lock(mutex_);
  if (!servers_[server].gone_since) servers_[server].gone_since = now;
  Rest(server, now);
}

void ServerPool::Rest(size_t server, TimePoint now) {
  Server& lost = servers_[server];
  if (lost.rests_until > now) return;
  const auto rest = kFirstRest * (1 << std::min(lost.losses, 10));
  lost.rests_until = now + std::min<std::chrono::milliseconds>(rest, kLongestRest);
  ++lost.losses;
}

void ServerPool::Busy(size_t server, TimePoint now, std::chrono::milliseconds delay) {
  const std::lock_guard lock(mutex_);
  Server& busy = servers_[server];
  busy.losses = 0;
  busy.gone_since.reset();
  busy.rests_until = std::max(busy.rests_until, now + std::clamp(delay, kShortestDelay, kLongestRest));
}

}  // namespace voxelpipe::cli
