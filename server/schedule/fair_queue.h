// Tasks that wait, and whose turn it is: start-time fair queueing, first among priorities, then among the clients of
// one.
//
// Source: P. Goyal, H. Vin, H. Cheng, "Start-time Fair Queueing", SIGCOMM 1996: who was served pays with virtual time,
// in proportion to the work and against its weight, and the client that has paid least is next. No credit accumulates:
// a client that arrives, or was held back, starts at the present. Changed: tasks stand in lanes, and who asks names the
// lanes that it can take from; the order is one for all lanes together. A task that several clients wait for stands in
// a place of each.
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

// Not thread-safe. Everything is O(log of the clients that wait), however many tasks do.
class FairQueue {
 public:
  static constexpr size_t kLanes = 9;
  using Lanes = uint32_t;  // bit l stands for lane l
  static constexpr Lanes kAllLanes = (1u << kLanes) - 1;

  // What one priority gets of the work while all have some, against the others.
  explicit FairQueue(const std::array<double, kPriorities>& weights);
  FairQueue(const FairQueue&) = delete;
  FairQueue& operator=(const FairQueue&) = delete;

  // `cost_ms`: the work that the client pays for. The task must not be here yet. Of one client, priority and lane it
  // comes after those that are.
  void Push(std::shared_ptr<Task> task, size_t lane, Priority priority, const std::string& client, double cost_ms);
  // True if a client's tasks are passed over.
  using Skip = std::function<bool(const std::string& client)>;
  // Whose turn it is among these lanes, and in which it stands; null where none waits. Pop takes it out and makes its
  // client pay. Clients that `skip`, if given, is true for are passed over.
  const Task* Front(Lanes lanes, size_t* lane = nullptr, const Skip& skip = {}) const;
  std::shared_ptr<Task> Pop(Lanes lanes, const Skip& skip = {});
  // Whose turn a task waits for.
  struct Stand {
    std::string client;
    Priority priority = Priority::kNormal;
    bool operator==(const Stand&) const = default;
  };
  // Makes a task that is here stand in these places, at least one and no two of them equal, and in no others: it is
  // taken when the first of them has its turn, and the client of that one pays. Places that it has already stay where
  // they are in the queue, those that were raised, too. False where the task is not here.
  bool SetStands(const Task& task, std::span<const Stand> stands);
  // Takes one out of turn; null where it is not here.
  std::shared_ptr<Task> Remove(const Task& task);
  // Puts it one priority higher. False where it is not here or cannot rise.
  bool Raise(const Task& task);
  // Puts it into another lane, behind those that are there. It must be here.
  void Move(const Task& task, size_t lane);

  // Calls visit(task) for each, in no order.
  template <typename Visit>
  void ForEach(const Visit& visit) const {
    for (const auto& [task, place] : places_) visit(*task);
  }

  size_t size() const { return places_.size(); }
  size_t size(size_t lane) const { return lane_sizes_[lane]; }
  size_t size(Priority priority) const { return levels_[size_t(priority)].waiting - levels_[size_t(priority)].further; }
  // Lanes where tasks wait.
  Lanes lanes() const { return lanes_; }
  double waiting_ms() const { return waiting_ms_; }
  // Of the tasks in these lanes.
  double waiting_ms(Lanes lanes) const;
  // Of one client, in all priorities.
  size_t WaitingOf(const std::string& client) const;
  // How much of the work that waits would be done before a new task of this client and cost is.
  double AheadMs(Priority priority, const std::string& client, double cost_ms) const;

 private:
  struct Level;
  struct Item {
    std::shared_ptr<Task> task;
    double cost_ms;
    uint64_t number;
    bool further;  // beside another place of the task, which is the one that counts as waiting work
  };
  // What one client waits for within a priority.
  struct Flow {
    Level* level = nullptr;
    std::string client;
    double paid = 0;    // virtual time, against level->now
    uint64_t turn = 0;  // of equals, the one that has waited longer for its turn goes first
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
    double now = 0;   // the present of its flows
    std::unordered_map<std::string, Flow> flows;
    std::array<std::set<Turn>, kLanes> turns;  // flows with tasks in the lane
    std::set<Turn> resting;                    // without tasks, but ahead of the present: their debt is remembered
    size_t waiting = 0, clients = 0;           // flows that wait
    size_t further = 0;                        // of `waiting`
    double waiting_ms = 0;
  };
  struct Place {
    Flow* flow;
    size_t lane;
    std::list<Item>::iterator item;
    Priority asked;  // the flow's may have risen
  };
  using Places = std::vector<Place>;

  // The lane and flow whose turn it is; null where none.
  std::pair<Flow*, size_t> Next(Lanes lanes, const Skip& skip) const;
  Flow& Wake(Level& level, const std::string& client);
  Place Put(std::shared_ptr<Task> task, size_t lane, Priority priority, const std::string& client, double cost_ms,
            bool further);
  // All places of a task that is here, the one that counts in front.
  Places PlacesOf(const Task& task) const;
  void SetPlaces(const Task& task, Places places);
  // Makes one that was further the one that counts.
  void Count(const Place& place);
  Item TakeOut(const Place& place);
  void Pay(Flow& flow, double cost_ms);
  void Settle(Level& level);

  std::array<Level, kPriorities> levels_;
  std::unordered_map<const Task*, Place> places_;
  std::unordered_map<const Task*, Places> further_;  // of tasks that stand in several places
  std::array<size_t, kLanes> lane_sizes_{};
  std::array<double, kLanes> lane_ms_{};
  Lanes lanes_ = 0;
  double now_ = 0;
  double waiting_ms_ = 0;
  uint64_t next_number_ = 0;
};

}  // namespace voxelpipe
