// An LRU cache with a limit in bytes and a fair share for each client.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <iterator>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "meshes/byte_lru.h"

namespace voxelpipe {

// Values by name, each with the clients that have a claim on it: at least one, of whom the first pays for its bytes.
// Any client's use keeps a value.
//
// Every client that pays for something has a share: the limit divided by the number of these clients. Eviction takes
// the least recently used values of clients above their share, so that inserts of others never evict the recently used
// values of a client that fit into its share. Only values unused for `idle` are evicted earlier, claimed or not:
// clients that left do not reduce the others' shares. A value evicted from its payer's share moves to the next
// claimant, if there is one. Evicted values live as long as others hold them; the thread whose call evicts values
// without holders destroys them, without the lock. Thread-safe.
template <typename Value>
class ClaimedLru {
 public:
  using Clock = std::chrono::steady_clock;

  // `now`: for tests; otherwise the clock.
  ClaimedLru(uint64_t limit_bytes, Clock::duration idle, std::function<Clock::time_point()> now = {})
      : limit_(limit_bytes), idle_(idle), now_(std::move(now)) {}

  struct Inserted {
    std::shared_ptr<Value> value;  // stored under the key: the new value, or an earlier one; null if there is no room
    uint64_t room = 0;             // bytes available for this client and value, if too few
  };
  // Inserts `value` of `bytes` bytes as most recently used, with a claim of `client`. No effect if there is no room for
  // it.
  Inserted Insert(const std::string& key, std::shared_ptr<Value> value, uint64_t bytes, const std::string& client) {
    std::vector<Step> steps;
    const std::lock_guard lock(mutex_);  // released before the values in `steps` are destroyed
    if (const auto found = entries_.find(key); found != entries_.end()) {
      AddClaim(found->second, client);
      ToFront(found->second);
      return {found->second.value, 0};
    }
    if (bytes > limit_) return {nullptr, limit_};
    Entry& entry = entries_[key];
    entry.key = key;
    entry.value = std::move(value);
    entry.bytes = bytes;
    entry.claims = {client};
    entry.number = next_number_++;
    Stamp(entry);
    Attach(entry);
    bytes_ += bytes;
    if (MakeRoom(&entry, steps)) {
      CountEvictions(steps);
      return {entry.value, 0};
    }
    const uint64_t room = limit_ - (bytes_ - bytes);
    Undo(steps);
    steps.push_back(Evict(entry));
    return {nullptr, room};
  }

  // The value, adding a claim of `client`; it becomes the most recently used; null if there is none.
  std::shared_ptr<Value> Claim(const std::string& key, const std::string& client) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end()) return nullptr;
    AddClaim(found->second, client);
    ToFront(found->second);
    return found->second.value;
  }

  // The value, which becomes the most recently used; null if there is none.
  std::shared_ptr<Value> Use(const std::string& key) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    ++(found == entries_.end() ? misses_ : hits_);
    return found == entries_.end() ? nullptr : ToFront(found->second);
  }

  // The same, but not counted.
  std::shared_ptr<Value> Touch(const std::string& key) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    return found == entries_.end() ? nullptr : ToFront(found->second);
  }

  // The value, without counting or changing the order.
  std::shared_ptr<Value> Peek(const std::string& key) const {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    return found == entries_.end() ? nullptr : found->second.value;
  }

  // Sets the size of a value to `bytes`. Evicts others to make room for it as in Insert, and itself if that is not
  // enough. No effect if `key` does not hold `value`.
  void Resize(const std::string& key, const Value* value, uint64_t bytes) {
    std::vector<Step> steps;
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end() || found->second.value.get() != value) return;
    Entry& entry = found->second;
    Detach(entry);
    bytes_ = bytes_ - entry.bytes + bytes;
    entry.bytes = bytes;
    Stamp(entry);
    Attach(entry);
    if (!MakeRoom(&entry, steps)) {
      Undo(steps);
      while (!entry.claims.empty()) steps.push_back(Evict(entry));
    }
    CountEvictions(steps);
  }

  enum class Released { kNoClaim, kStays, kGone };
  // Releases the client's claim; without any other claim the value is moved to `gone`, so that the caller chooses the
  // thread that frees it.
  Released Release(const std::string& key, const std::string& client, std::shared_ptr<Value>& gone) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end()) return Released::kNoClaim;
    Entry& entry = found->second;
    const auto claim = std::find(entry.claims.begin(), entry.claims.end(), client);
    if (claim == entry.claims.end()) return Released::kNoClaim;
    if (entry.claims.size() > 1) {
      Detach(entry);
      entry.claims.erase(claim);
      Attach(entry);
      return Released::kStays;
    }
    gone = Evict(entry).node.mapped().value;
    return Released::kGone;
  }

  struct Listed {
    std::shared_ptr<Value> value;
    uint64_t number = 0;  // grows with each value that is inserted
  };
  // The values on which `client` has a claim, of null all of them; at most `count`, the newest first, of those with a
  // number below `before` if that is given. Neither counted nor used.
  std::vector<Listed> List(const std::string* client, std::optional<uint64_t> before, size_t count) const {
    std::vector<Listed> list;
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [key, entry] : entries_) {
        if (before && entry.number >= *before) continue;
        if (client == nullptr || Claims(entry, *client)) list.push_back({entry.value, entry.number});
      }
    }
    std::sort(list.begin(), list.end(), [](const Listed& a, const Listed& b) { return a.number > b.number; });
    if (list.size() > count) list.resize(count);
    return list;
  }

  // Removes and returns a value whatever claims it has; null if there is none.
  std::shared_ptr<Value> Erase(const std::string& key) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end()) return nullptr;
    std::shared_ptr<Value> value = std::move(found->second.value);
    found->second.claims.resize(1);
    Evict(found->second);
    return value;
  }

  LruStats stats() const {
    const std::lock_guard lock(mutex_);
    return {entries_.size(), bytes_, hits_, misses_, evictions_};
  }
  // Evicts values that do not fit any more, as in Insert.
  void set_limit_bytes(uint64_t limit) {
    std::vector<Step> steps;
    const std::lock_guard lock(mutex_);
    limit_ = limit;
    MakeRoom(nullptr, steps);
    CountEvictions(steps);
  }
  uint64_t limit_bytes() const {
    const std::lock_guard lock(mutex_);
    return limit_;
  }

 private:
  struct Entry {
    std::string key;
    std::shared_ptr<Value> value;
    uint64_t bytes = 0;
    std::vector<std::string> claims;  // the first one pays
    uint64_t number = 0;              // order of insertion
    uint64_t turn = 0;                // of its last use
    Clock::time_point used;
    typename std::list<Entry*>::iterator place;  // in its payer's order
  };
  using Entries = std::unordered_map<std::string, Entry>;
  struct Payer {
    std::list<Entry*> order;  // most recently used first
    uint64_t bytes = 0;
  };
  // The result of Evict.
  struct Step {
    typename Entries::node_type node;  // empty if another claimant took it over
    Entry* entry = nullptr;
    std::string claim;
  };

  void Stamp(Entry& entry) {
    entry.turn = next_turn_++;
    entry.used = now_ ? now_() : Clock::now();
  }
  std::shared_ptr<Value> ToFront(Entry& entry) {
    Stamp(entry);
    std::list<Entry*>& order = payers_[entry.claims.front()].order;
    order.splice(order.begin(), order, entry.place);
    return entry.value;
  }
  void AddClaim(Entry& entry, const std::string& client) {
    if (!Claims(entry, client)) entry.claims.push_back(client);
  }
  static bool Claims(const Entry& entry, const std::string& client) {
    return std::find(entry.claims.begin(), entry.claims.end(), client) != entry.claims.end();
  }
  void Attach(Entry& entry) {
    Payer& payer = payers_[entry.claims.front()];
    auto at = payer.order.begin();
    if (!payer.order.empty() && payer.order.front()->turn > entry.turn) {  // an old one belongs near the end
      for (at = payer.order.end(); (*std::prev(at))->turn < entry.turn;) --at;
    }
    entry.place = payer.order.insert(at, &entry);
    payer.bytes += entry.bytes;
  }
  void Detach(Entry& entry) {
    const auto payer = payers_.find(entry.claims.front());
    payer->second.order.erase(entry.place);
    payer->second.bytes -= entry.bytes;
    if (payer->second.order.empty()) payers_.erase(payer);
  }
  // Removes the payer's claim, and the entry if there is no other claim.
  Step Evict(Entry& entry) {
    Step step;
    step.entry = &entry;
    Detach(entry);
    step.claim = std::move(entry.claims.front());
    entry.claims.erase(entry.claims.begin());
    if (!entry.claims.empty()) {
      Attach(entry);
    } else {
      bytes_ -= entry.bytes;
      step.node = entries_.extract(entry.key);
    }
    return step;
  }
  void Undo(std::vector<Step>& steps) {
    for (; !steps.empty(); steps.pop_back()) {
      Step& step = steps.back();
      Entry& entry = *step.entry;
      if (step.node.empty()) {
        Detach(entry);
      } else {
        bytes_ += entry.bytes;
        entries_.insert(std::move(step.node));
      }
      entry.claims.insert(entry.claims.begin(), std::move(step.claim));
      Attach(entry);
    }
  }
  // False if everything fits only without `fresh`, if given, the most recently used one.
  bool MakeRoom(const Entry* fresh, std::vector<Step>& steps) {
    while (bytes_ > limit_) {
      Entry* const next = NextToGo(fresh);
      if (next == nullptr) return false;
      steps.push_back(Evict(*next));
    }
    return true;
  }
  Entry* NextToGo(const Entry* fresh) {
    const uint64_t share = limit_ / std::max<size_t>(1, payers_.size());
    Entry *oldest = nullptr, *beyond = nullptr;
    for (auto& [client, payer] : payers_) {
      Entry* const last = payer.order.back();
      if (last == fresh) continue;
      if (oldest == nullptr || last->turn < oldest->turn) oldest = last;
      if (payer.bytes > share && (beyond == nullptr || last->turn < beyond->turn)) beyond = last;
    }
    if (oldest != nullptr && (now_ ? now_() : Clock::now()) - oldest->used >= idle_) return oldest;
    return beyond;
  }
  void CountEvictions(const std::vector<Step>& steps) {
    for (const Step& step : steps) evictions_ += step.node.empty() ? 0 : 1;
  }

  uint64_t limit_;
  const Clock::duration idle_;
  const std::function<Clock::time_point()> now_;
  mutable std::mutex mutex_;
  Entries entries_;
  std::map<std::string, Payer> payers_;  // with at least one entry each
  uint64_t bytes_ = 0, next_turn_ = 0, next_number_ = 0, hits_ = 0, misses_ = 0, evictions_ = 0;
};

}  // namespace voxelpipe
