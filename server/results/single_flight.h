// Equal work that is wanted several times at once is done once, for all who want it.
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

// The first to join a flight does the work (or hands it to a worker) and lands the flight with what came of it; all who
// joined get the same answer. Who leaves does not disturb the others; when the last one has left, the work is
// cancelled. Thread-safe; all functions of others are called without a lock. Must outlive its flights.
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
    bool over = false;  // landed, or everybody left
    std::function<void()> on_empty;
  };

  // A place in a flight.
  struct Seat {
    std::shared_ptr<Flight> flight;
    uint64_t ticket = 0;
    bool first = false;  // whose holder must see to it that the flight lands
  };

  // Joins the flight of this name, or starts one. A flight that has landed, or that all have left, is not joined.
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

  // For the first one: `stop` is called when everybody has left before the flight landed, at once if that is so
  // already; by the last one to leave.
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

  // Gives a place up: true where its `done` was not called and never will be; false where the flight has landed.
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

  // Tells all who wait now.
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

  // Ends the flight: an error goes to all as well. A second landing does nothing.
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

  // How many wait for this flight now.
  size_t waiting(const std::shared_ptr<Flight>& flight) const {
    const std::lock_guard lock(mutex_);
    return flight->waiters.size();
  }
  // How many joined a flight that others had started.
  uint64_t shared() const {
    const std::lock_guard lock(mutex_);
    return shared_;
  }
  // True if a newcomer joins others.
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
