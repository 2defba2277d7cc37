// The waiting tasks and their order: start-time fair queueing, first among priorities, then among the clients of a
// priority.
//
// Source: P. Goyal, H. Vin, H. Cheng, "Start-time Fair Queueing", SIGCOMM 1996: a served client advances its virtual
// time by the work divided by its weight, and the client with the least virtual time is next. No credit accumulates: a
// client that arrives, or was held back, starts at the current virtual time. Changed: tasks are in lanes, and a worker
// names the lanes that it takes from; all lanes have one common order. A task that several clients wait for has a place
// in the queue of each.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "schedule/task.h"

namespace voxelpipe {

// Not thread-safe. All operations are O(log of the waiting clients), independent of the number of tasks.
class FairQueue {
 public:
  static constexpr size_t kLanes = 9;
  using Lanes = uint32_t;  // bit l: lane l
  static constexpr Lanes kAllLanes = (1u << kLanes) - 1;

  // Weights: the relative shares of the priorities while all have work.
  explicit FairQueue(const std::array<double, kPriorities>& weights);
  FairQueue(const FairQueue&) = delete;
  FairQueue& operator=(const FairQueue&) = delete;

  // `cost_ms`: the work charged to the client. The task must not be queued yet. FIFO within client, priority and lane.
  void Push(std::shared_ptr<Task> task, size_t lane, Priority priority, const std::string& client, double cost_ms);
  // True if a client's tasks are skipped.
  using Skip = std::function<bool(const std::string& client)>;
  // The next task of these lanes, and its lane; null if none waits. Pop removes it and charges its client. Skips
  // clients for which `skip`, if given, is true.
  const Task* Front(Lanes lanes, size_t* lane = nullptr, const Skip& skip = {}) const;
  std::shared_ptr<Task> Pop(Lanes lanes, const Skip& skip = {});
  // A place of a task: the client and the priority in whose queue it waits.
  struct Stand {
    std::string client;
    Priority priority = Priority::kNormal;
    bool operator==(const Stand&) const = default;
  };
  // Sets the places of a queued task: at least one, all different. It is taken at the turn of the first of them, whose
  // client is charged. Existing places, also raised ones, keep their positions in the queue. False if the task is not
  // queued.
  bool SetStands(const Task& task, std::span<const Stand> stands);
  // Removes a task out of order; null if it is not queued.
  std::shared_ptr<Task> Remove(const Task& task);
  // Raises it by one priority. False if it is not queued or already at the top.
  bool Raise(const Task& task);
  // Moves it to the end of another lane. It must be queued.
  void Move(const Task& task, size_t lane);

  // Calls visit(task) for each, in no particular order.
  template <typename Visit>
  void ForEach(const Visit& visit) const {
    for (const auto& [task, place] : places_) visit(*task);
  }

  size_t size() const { return places_.size(); }
  size_t size(size_t lane) const { return lane_sizes_[lane]; }
  size_t size(Priority priority) const { return levels_[size_t(priority)].waiting - levels_[size_t(priority)].further; }
  // Lanes with waiting tasks.
  Lanes lanes() const { return lanes_; }
  double waiting_ms() const { return waiting_ms_; }
  // Of the tasks in these lanes.
  double waiting_ms(Lanes lanes) const;
  // Of one client, in all priorities.
  size_t WaitingOf(const std::string& client) const;
  // The waiting work that would be done before a new task of this client and cost.
  double AheadMs(Priority priority, const std::string& client, double cost_ms) const;

 private:
  struct Level;
  struct Item {
    std::shared_ptr<Task> task;
    double cost_ms;
    uint64_t number;
    bool further;  // an additional place of the task; another one counts as waiting work
  };
  // The waiting tasks of one client within a priority.
  struct Flow {
    Level* level = nullptr;
    std::string client;
    double paid = 0;    // virtual time, against level->now
    uint64_t turn = 0;  // tie-breaker: the one that has waited longer is first
    std::array<std::list<Item>, kLanes> lanes;
    size_t waiting = 0;
    double waiting_ms = 0;
  };
  struct Turn {
    double paid;
    uint64_t turn;
    Flow* flow;
    friend bool operator<(const Turn& a, const Turn& b) { return a.paid != b.paid ? a.paid < b.paid : a.turn < b.turn; }
  };
  struct Level {
    Priority priority = Priority::kNormal;
    double weight = 1;
    double paid = 0;  // virtual time, against now_
    double now = 0;   // the virtual time of its flows
    std::unordered_map<std::string, Flow> flows;
    std::array<std::set<Turn>, kLanes> turns;  // flows with tasks in the lane
    std::set<Turn> resting;                    // without tasks, but ahead of the virtual time, which is remembered
    size_t waiting = 0, clients = 0;           // waiting flows
    size_t further = 0;                        // of `waiting`
    double waiting_ms = 0;
  };
  struct Place {
    Flow* flow;
    size_t lane;
    std::list<Item>::iterator item;
    Priority asked;  // the flow's priority may have been raised
  };
  using Places = std::vector<Place>;

  // The next lane and flow; null if there is none.
  std::pair<Flow*, size_t> Next(Lanes lanes, const Skip& skip) const;
  Flow& Wake(Level& level, const std::string& client);
  Place Put(std::shared_ptr<Task> task, size_t lane, Priority priority, const std::string& client, double cost_ms,
            bool further);
  // All places of a queued task, first the one that counts.
  Places PlacesOf(const Task& task) const;
  void SetPlaces(const Task& task, Places places);
  // Makes an additional place the one that counts.
  void Count(const Place& place);
  Item TakeOut(const Place& place);
  void Pay(Flow& flow, double cost_ms);
  void Settle(Level& level);

  std::array<Level, kPriorities> levels_;
  std::unordered_map<const Task*, Place> places_;
  std::unordered_map<const Task*, Places> further_;  // of tasks with several places
  std::array<size_t, kLanes> lane_sizes_{};
  std::array<double, kLanes> lane_ms_{};
  Lanes lanes_ = 0;
  double now_ = 0;
  double waiting_ms_ = 0;
  uint64_t next_number_ = 0;
};

}  // namespace voxelpipe
