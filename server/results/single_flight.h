// Single flight: concurrent requests for the same work share one run.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

#include "absl/status/statusor.h"

namespace voxelpipe {

// The first to join a flight does the work (or hands it to a worker) and lands the flight with its result; all waiters
// get the same answer. A waiter that leaves does not affect the others; when the last one has left, the work is
// cancelled. Thread-safe; callbacks are called without a lock. Must outlive its flights.
template <typename Result, typename News = std::monostate>
class SingleFlight {
 public:
  using Answer = absl::StatusOr<std::shared_ptr<Result>>;

  struct Waiter {
    std::function<void(const Answer&)> done;  // once, unless the waiter left; on the thread that lands the flight
    std::function<void(const News&)> news;    // may be empty; any number of times, before `done`
  };

  class Flight {
   public:
    explicit Flight(std::string name) : key(std::move(name)) {}
    const std::string key;

   private:
    friend class SingleFlight;
    std::unordered_map<uint64_t, Waiter> waiters;  // all of these with mutex_ held
    uint64_t next_ticket = 1;
    bool over = false;  // landed, or all waiters left
    std::function<void()> on_empty;
  };

  // A seat of a waiter in a flight.
  struct Seat {
    std::shared_ptr<Flight> flight;
    uint64_t ticket = 0;
    bool first = false;  // true: its holder must make the flight land
  };

  // Joins the flight of this name, or starts one. Never joins a flight that has landed, or that all waiters have left.
  Seat Join(const std::string& key, Waiter waiter) {
    const std::lock_guard lock(mutex_);
    std::shared_ptr<Flight>& flight = flights_[key];
    const bool first = flight == nullptr;
    if (first) {
      flight = std::make_shared<Flight>(key);
    } else {
      ++shared_;
    }
    const uint64_t ticket = flight->next_ticket++;
    flight->waiters.emplace(ticket, std::move(waiter));
    return {flight, ticket, first};
  }

  // For the first one: the last waiter to leave calls `stop`, if all leave before the flight lands; called immediately
  // if all have already left.
  void WhenEmpty(const std::shared_ptr<Flight>& flight, std::function<void()>&& stop) {
    {
      const std::lock_guard lock(mutex_);
      if (!flight->over) {
        flight->on_empty = std::move(stop);
        return;
      }
      if (!flight->waiters.empty()) return;
    }
    stop();
  }

  // Leaves a flight: true if its `done` was not called and never will be; false if the flight has landed.
  bool Leave(const Seat& seat) {
    std::function<void()> stop;
    Waiter gone;  // destroyed without the lock
    {
      const std::lock_guard lock(mutex_);
      Flight& flight = *seat.flight;
      const auto found = flight.waiters.find(seat.ticket);
      if (found == flight.waiters.end()) return false;
      gone = std::move(found->second);
      flight.waiters.erase(found);
      if (flight.over || !flight.waiters.empty()) return true;
      EndLocked(flight);
      stop = std::move(flight.on_empty);
    }
    if (stop) stop();
    return true;
  }

  // Sends news to all current waiters.
  void Tell(const std::shared_ptr<Flight>& flight, const News& news) {
    std::vector<std::function<void(const News&)>> listeners;
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [ticket, waiter] : flight->waiters) {
        if (waiter.news) listeners.push_back(waiter.news);
      }
    }
    for (const auto& listener : listeners) listener(news);
  }

  // Lands the flight; an error goes to all waiters as well. A second landing has no effect.
  void Land(const std::shared_ptr<Flight>& flight, const Answer& answer) {
    std::unordered_map<uint64_t, Waiter> waiters;
    std::function<void()> never;
    {
      const std::lock_guard lock(mutex_);
      if (flight->over) return;
      EndLocked(*flight);
      waiters.swap(flight->waiters);
      never = std::move(flight->on_empty);
    }
    for (const auto& [ticket, waiter] : waiters) waiter.done(answer);
  }

  // The current number of waiters of this flight.
  size_t waiting(const std::shared_ptr<Flight>& flight) const {
    const std::lock_guard lock(mutex_);
    return flight->waiters.size();
  }
  // The number of waiters that joined a flight started by others.
  uint64_t shared() const {
    const std::lock_guard lock(mutex_);
    return shared_;
  }
  // True if a new waiter would join a flight.
  bool IsFlying(const std::string& key) const {
    const std::lock_guard lock(mutex_);
    return flights_.contains(key);
  }
  // Flights that have not landed yet.
  size_t flying() const {
    const std::lock_guard lock(mutex_);
    return flights_.size();
  }

 private:
  void EndLocked(Flight& flight) {
    flight.over = true;
    flights_.erase(flight.key);
  }

  mutable std::mutex mutex_;
  std::unordered_map<std::string, std::shared_ptr<Flight>> flights_;
  uint64_t shared_ = 0;
};

}  // namespace voxelpipe
