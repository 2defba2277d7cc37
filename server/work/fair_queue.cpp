#include "work/fair_queue.h"

#include <algorithm>
#include <utility>

namespace voxelpipe {
namespace {

// Nothing is free: handing a task over costs about so much.
constexpr double kLeastMs = 0.02;

}  // namespace

FairQueue::FairQueue(const std::array<double, kPriorities>& weights) {
  for (size_t p = 0; p < kPriorities; ++p) {
    levels_[p].priority = Priority(p);
    levels_[p].weight = weights[p];
  }
}

void FairQueue::Push(std::shared_ptr<Task> task, size_t lane, Priority priority, const std::string& client,
                     double cost_ms) {
  Level& level = levels_[size_t(priority)];
  Flow& flow = Wake(level, client);
  const Task* key = task.get();
  std::list<Item>& items = flow.lanes[lane];
  items.push_back({std::move(task), cost_ms, next_number_++});
  if (items.size() == 1) level.turns[lane].insert({flow.paid, flow.turn, &flow});
  places_[key] = {&flow, lane, std::prev(items.end())};
  if (lane_sizes_[lane]++ == 0) lanes_ |= 1u << lane;
  lane_ms_[lane] += cost_ms;
  if (flow.waiting++ == 0) ++level.clients;
  if (level.waiting++ == 0) level.paid = std::max(level.paid, now_);
  flow.waiting_ms += cost_ms;
  level.waiting_ms += cost_ms;
  waiting_ms_ += cost_ms;
}

double FairQueue::waiting_ms(Lanes lanes) const {
  double ms = 0;
  for (size_t lane = 0; lane < kLanes; ++lane) ms += (lanes >> lane & 1) != 0 ? lane_ms_[lane] : 0;
  return ms;
}

FairQueue::Flow& FairQueue::Wake(Level& level, const std::string& client) {
  Flow& flow = level.flows[client];
  if (flow.level == nullptr) {
    flow.level = &level;
    flow.client = client;
  }
  if (flow.waiting > 0) return flow;
  level.resting.erase({flow.paid, flow.turn, &flow});
  flow.paid = std::max(flow.paid, level.now);
  flow.turn = next_number_++;
  return flow;
}

std::pair<FairQueue::Flow*, size_t> FairQueue::Next(Lanes lanes, const Skip& skip) const {
  lanes &= lanes_;
  const Level* best_level = nullptr;
  const Turn* best = nullptr;
  size_t best_lane = 0;
  for (const Level& level : levels_) {
    if (level.waiting == 0 || (best_level != nullptr && level.paid >= best_level->paid)) continue;
    const Turn* found = nullptr;
    size_t found_lane = 0;
    for (size_t lane = 0; lane < kLanes; ++lane) {
      if ((lanes >> lane & 1) == 0) continue;
      const std::set<Turn>& turns = level.turns[lane];
      auto first = turns.begin();
      while (first != turns.end() && skip && skip(first->flow->client)) ++first;
      if (first == turns.end()) continue;
      const Turn& turn = *first;
      const auto number = [](const Turn& t, size_t l) { return t.flow->lanes[l].front().number; };
      if (found == nullptr || turn < *found ||
          (turn.flow == found->flow && number(turn, lane) < number(*found, found_lane))) {
        found = &turn;
        found_lane = lane;
      }
    }
    if (found == nullptr) continue;
    best_level = &level;
    best = found;
    best_lane = found_lane;
  }
  return {best == nullptr ? nullptr : best->flow, best_lane};
}

const Task* FairQueue::Front(Lanes lanes, size_t* lane, const Skip& skip) const {
  const auto [flow, found] = Next(lanes, skip);
  if (flow == nullptr) return nullptr;
  if (lane != nullptr) *lane = found;
  return flow->lanes[found].front().task.get();
}

std::shared_ptr<Task> FairQueue::Pop(Lanes lanes, const Skip& skip) {
  const auto [flow, lane] = Next(lanes, skip);
  if (flow == nullptr) return nullptr;
  Level& level = *flow->level;
  const Item item = TakeOut({flow, lane, flow->lanes[lane].begin()});
  Pay(*flow, std::max(item.cost_ms, kLeastMs));
  Settle(level);
  return item.task;
}

// The present moves to where who is served stood; what held-back ones might have saved up by then is lost.
void FairQueue::Pay(Flow& flow, double cost_ms) {
  Level& level = *flow.level;
  now_ = std::max(now_, level.paid);
  level.paid = now_ + cost_ms / level.weight;
  level.now = std::max(level.now, flow.paid);

  const Turn before{flow.paid, flow.turn, &flow};
  const Turn after{level.now + cost_ms, next_number_++, &flow};
  for (size_t lane = 0; lane < kLanes; ++lane) {
    if (flow.lanes[lane].empty()) continue;
    auto node = level.turns[lane].extract(before);
    node.value() = after;
    level.turns[lane].insert(std::move(node));
  }
  if (flow.waiting == 0) {
    level.resting.erase(before);
    level.resting.insert(after);
  }
  flow.paid = after.paid;
  flow.turn = after.turn;
}

// Forgets clients whose debt is paid: all, once nobody is left to pay it to.
void FairQueue::Settle(Level& level) {
  if (level.waiting == 0) {
    for (const Turn& turn : level.resting) level.now = std::max(level.now, turn.paid);
  }
  while (!level.resting.empty() && level.resting.begin()->paid <= level.now) {
    Flow* flow = level.resting.begin()->flow;
    level.resting.erase(level.resting.begin());
    level.flows.erase(std::string(flow->client));
  }
  if (places_.empty()) {
    for (const Level& other : levels_) now_ = std::max(now_, other.paid);
    waiting_ms_ = 0;  // sums of doubles drift
  }
  if (level.waiting == 0) level.waiting_ms = 0;
}

FairQueue::Item FairQueue::TakeOut(const Place& place) {
  Flow& flow = *place.flow;
  Level& level = *flow.level;
  std::list<Item>& items = flow.lanes[place.lane];
  Item item = std::move(*place.item);
  places_.erase(item.task.get());
  items.erase(place.item);
  if (items.empty()) level.turns[place.lane].erase({flow.paid, flow.turn, &flow});
  lane_ms_[place.lane] -= item.cost_ms;
  if (--lane_sizes_[place.lane] == 0) {
    lanes_ &= ~(1u << place.lane);
    lane_ms_[place.lane] = 0;  // sums of doubles drift
  }
  flow.waiting_ms -= item.cost_ms;
  level.waiting_ms -= item.cost_ms;
  waiting_ms_ -= item.cost_ms;
  --level.waiting;
  if (--flow.waiting == 0) {
    flow.waiting_ms = 0;
    --level.clients;
    level.resting.insert({flow.paid, flow.turn, &flow});
  }
  return item;
}

std::shared_ptr<Task> FairQueue::Remove(const Task& task) {
  const auto it = places_.find(&task);
  if (it == places_.end()) return nullptr;
  Level& level = *it->second.flow->level;
  Item item = TakeOut(Place(it->second));
  Settle(level);
  return std::move(item.task);
}

bool FairQueue::Raise(const Task& task) {
  const auto it = places_.find(&task);
  if (it == places_.end()) return false;
  const Place place = it->second;
  Level& level = *place.flow->level;
  if (level.priority == Priority::kHigh) return false;
  const std::string client = place.flow->client;
  Item item = TakeOut(place);
  Settle(level);
  Push(std::move(item.task), place.lane, Priority(size_t(level.priority) - 1), client, item.cost_ms);
  return true;
}

void FairQueue::Move(const Task& task, size_t lane) {
  const Place place = places_.at(&task);
  const Priority priority = place.flow->level->priority;
  const std::string client = place.flow->client;
  Item item = TakeOut(place);
  Push(std::move(item.task), lane, priority, client, item.cost_ms);
}

size_t FairQueue::WaitingOf(const std::string& client) const {
  size_t waiting = 0;
  for (const Level& level : levels_) {
    const auto it = level.flows.find(client);
    if (it != level.flows.end()) waiting += it->second.waiting;
  }
  return waiting;
}

double FairQueue::AheadMs(Priority priority, const std::string& client, double cost_ms) const {
  const Level& level = levels_[size_t(priority)];
  const auto it = level.flows.find(client);
  const double own = it == level.flows.end() ? 0 : it->second.waiting_ms;
  const bool waits = it != level.flows.end() && it->second.waiting > 0;
  // Every other client gets as much as this one, as long as it has work for it; every other priority its share of that.
  const double clients = double(level.clients + (waits ? 0 : 1));
  const double here = std::min(level.waiting_ms, clients * (own + cost_ms));
  double ahead = here;
  for (const Level& other : levels_) {
    if (&other != &level) ahead += std::min(other.waiting_ms, (here + cost_ms) * other.weight / level.weight);
  }
  return ahead;
}

}  // namespace voxelpipe
