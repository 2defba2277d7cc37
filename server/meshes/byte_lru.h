// An LRU cache with a limit in bytes.
#pragma once

#include <cstdint>
#include <iterator>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

namespace voxelpipe {

// Statistics of a store.
struct LruStats {
  uint64_t entries = 0, bytes = 0;  // now
  uint64_t hits = 0, misses = 0;    // of Use
  uint64_t evictions = 0;           // for lack of room, without explicit removals
};

// Values by name. Evicted values live as long as others hold them; the thread whose call evicts values without holders
// destroys them, without the lock. Thread-safe.
template <typename Value>
class ByteLru {
 public:
  explicit ByteLru(uint64_t limit_bytes) : limit_(limit_bytes) {}

  // Inserts `value` of `bytes` bytes as most recently used, and evicts the least recently used ones until all fit. Out:
  // the value stored under `key`: `value`, or an earlier one; null if `bytes` alone exceed the limit.
  std::shared_ptr<Value> Insert(const std::string& key, std::shared_ptr<Value> value, uint64_t bytes) {
    std::vector<std::shared_ptr<Value>> out;
    const std::lock_guard lock(mutex_);  // released before `out` goes
    if (const auto found = index_.find(key); found != index_.end()) {
      ToFront(found->second);
      return found->second->value;
    }
    if (bytes > limit_) return nullptr;
    order_.push_front({key, value, bytes});
    index_.emplace(key, order_.begin());
    bytes_ += bytes;
    MakeRoom(out);
    return value;
  }

  // The value, which becomes the most recently used; null if there is none.
  std::shared_ptr<Value> Use(const std::string& key) {
    const std::lock_guard lock(mutex_);
    const auto found = index_.find(key);
    if (found == index_.end()) {
      ++misses_;
      return nullptr;
    }
    ++hits_;
    ToFront(found->second);
    return found->second->value;
  }

  // The same, but not counted.
  std::shared_ptr<Value> Touch(const std::string& key) {
    const std::lock_guard lock(mutex_);
    const auto found = index_.find(key);
    if (found == index_.end()) return nullptr;
    ToFront(found->second);
    return found->second->value;
  }

  // The value, without counting or changing the order.
  std::shared_ptr<Value> Peek(const std::string& key) const {
    const std::lock_guard lock(mutex_);
    const auto found = index_.find(key);
    return found == index_.end() ? nullptr : found->second->value;
  }

  // Sets the size of a value to `bytes`. Evicts others to make room for it, or itself if it exceeds the limit. No
  // effect if `key` does not hold `value`.
  void Resize(const std::string& key, const Value* value, uint64_t bytes) {
    std::vector<std::shared_ptr<Value>> out;
    const std::lock_guard lock(mutex_);
    const auto found = index_.find(key);
    if (found == index_.end() || found->second->value.get() != value) return;
    bytes_ = bytes_ - found->second->bytes + bytes;
    found->second->bytes = bytes;
    ToFront(found->second);
    MakeRoom(out);
  }

  // Removes and returns a value; null if there is none.
  std::shared_ptr<Value> Erase(const std::string& key) {
    const std::lock_guard lock(mutex_);
    const auto found = index_.find(key);
    if (found == index_.end()) return nullptr;
    std::shared_ptr<Value> value = std::move(found->second->value);
    Drop(found->second);
    return value;
  }

  LruStats stats() const {
    const std::lock_guard lock(mutex_);
    return {order_.size(), bytes_, hits_, misses_, evictions_};
  }
  // Evicts values that do not fit any more.
  void set_limit_bytes(uint64_t limit) {
    std::vector<std::shared_ptr<Value>> out;
    const std::lock_guard lock(mutex_);  // released before `out` goes
    limit_ = limit;
    MakeRoom(out);
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
  };
  using Entries = std::list<Entry>;  // most recently used first

  void ToFront(typename Entries::iterator entry) { order_.splice(order_.begin(), order_, entry); }
  void Drop(typename Entries::iterator entry) {
    bytes_ -= entry->bytes;
    index_.erase(entry->key);
    order_.erase(entry);
  }
  void MakeRoom(std::vector<std::shared_ptr<Value>>& out) {
    while (bytes_ > limit_) {
      out.push_back(std::move(order_.back().value));
      Drop(std::prev(order_.end()));
      ++evictions_;
    }
  }

  uint64_t limit_;
  mutable std::mutex mutex_;
  Entries order_;
  std::unordered_map<std::string, typename Entries::iterator> index_;
  uint64_t bytes_ = 0, hits_ = 0, misses_ = 0, evictions_ = 0;
};

}  // namespace voxelpipe
