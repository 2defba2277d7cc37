#include "schedule/fair_queue.h"

#include <algorithm>
#include <utility>

namespace voxelpipe {
namespace {

// Minimum cost of a task: its hand-over.
constexpr double kMinMs = 0.02;

}  // namespace

FairQueue::FairQueue(const std::array<double, kPriorities>& weights) {
  for (size_t p = 0; p < kPriorities; ++p) {
    levels_[p].priority = Priority(p);
    levels_[p].weight = weights[p];
  }
}

void FairQueue::Push(std::shared_ptr<Task> task, size_t lane, Priority priority, const std::string& client,
                     double cost_ms) {
  const Task* key = task.get();
  places_[key] = Put(std::move(task), lane, priority, client, cost_ms, false);
}

FairQueue::Place FairQueue::Put(std::shared_ptr<Task> task, size_t lane, Priority priority, const std::string& client,
                                double cost_ms, bool further) {
  Level& level = levels_[size_t(priority)];
  Flow& flow = Wake(level, client);
  std::list<Item>& items = flow.lanes[lane];
  items.push_back({std::move(task), cost_ms, next_number_++, true});
  if (items.size() == 1) level.turns[lane].insert({flow.paid, flow.turn, &flow});
  if (lane_sizes_[lane]++ == 0) lanes_ |= 1u << lane;
  if (flow.waiting++ == 0) ++level.clients;
  if (level.waiting++ == 0) level.paid = std::max(level.paid, now_);
  ++level.further;
  const Place place{&flow, lane, std::prev(items.end()), priority};
  if (!further) Count(place);
  return place;
}

void FairQueue::Count(const Place& place) {
  place.item->further = false;
  const double ms = place.item->cost_ms;
  Level& level = *place.flow->level;
  --level.further;
  lane_ms_[place.lane] += ms;
  place.flow->waiting_ms += ms;
  level.waiting_ms += ms;
  waiting_ms_ += ms;
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
  const auto served = flow->lanes[lane].begin();
  const Task* key = served->task.get();
  std::vector<Level*> left;
  if (further_.contains(key)) {
    for (const Place& other : PlacesOf(*key)) {
      if (&*other.item == &*served) continue;
      left.push_back(other.flow->level);
      TakeOut(other);
    }
    further_.erase(key);
  }
  places_.erase(key);
  Level& level = *flow->level;
  const Item item = TakeOut({flow, lane, served, level.priority});
  Pay(*flow, std::max(item.cost_ms, kMinMs));
  Settle(level);
  for (Level* other : left) Settle(*other);
  return item.task;
}

// Virtual time advances to that of the served flow; held-back flows accumulate no credit.
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

// Removes clients whose virtual time has passed: all, if no other client is waiting.
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
  items.erase(place.item);
  if (items.empty()) level.turns[place.lane].erase({flow.paid, flow.turn, &flow});
  const double ms = item.further ? 0 : item.cost_ms;
  level.further -= item.further ? 1 : 0;
  lane_ms_[place.lane] -= ms;
  if (--lane_sizes_[place.lane] == 0) {
    lanes_ &= ~(1u << place.lane);
    lane_ms_[place.lane] = 0;  // sums of doubles drift
  }
  flow.waiting_ms -= ms;
  level.waiting_ms -= ms;
  waiting_ms_ -= ms;
  --level.waiting;
  if (--flow.waiting == 0) {
    flow.waiting_ms = 0;
    --level.clients;
    level.resting.insert({flow.paid, flow.turn, &flow});
  }
  return item;
}

FairQueue::Places FairQueue::PlacesOf(const Task& task) const {
  Places places{places_.at(&task)};
  if (const auto more = further_.find(&task); more != further_.end()) {
    places.insert(places.end(), more->second.begin(), more->second.end());
  }
  return places;
}

void FairQueue::SetPlaces(const Task& task, Places places) {
  places_[&task] = places.front();
  places.erase(places.begin());
  if (places.empty()) {
    further_.erase(&task);
  } else {
    further_[&task] = std::move(places);
  }
}

bool FairQueue::SetStands(const Task& task, std::span<const Stand> stands) {
  if (!places_.contains(&task)) return false;
  Places have = PlacesOf(task), places;
  const Place first = have.front();
  const std::shared_ptr<Task> owner = first.item->task;
  for (const Stand& stand : stands) {
    const auto there = std::find_if(have.begin(), have.end(), [&](const Place& place) {
      return place.asked == stand.priority && place.flow->client == stand.client;
    });
    if (there == have.end()) {
      places.push_back(Put(owner, first.lane, stand.priority, stand.client, first.item->cost_ms, true));
    } else {
      places.push_back(*there);
      have.erase(there);
    }
  }
  for (const Place& gone : have) {
    Level& level = *gone.flow->level;
    TakeOut(gone);
    Settle(level);
  }
  const auto counted =
      std::find_if(places.begin(), places.end(), [](const Place& place) { return !place.item->further; });
  if (counted == places.end()) {
    Count(places.front());
  } else {
    std::iter_swap(places.begin(), counted);
  }
  SetPlaces(task, std::move(places));
  return true;
}

std::shared_ptr<Task> FairQueue::Remove(const Task& task) {
  if (!places_.contains(&task)) return nullptr;
  const Places places = PlacesOf(task);
  std::shared_ptr<Task> owner = places.front().item->task;
  places_.erase(&task);
  further_.erase(&task);
  for (const Place& place : places) {
    Level& level = *place.flow->level;
    TakeOut(place);
    Settle(level);
  }
  return owner;
}

bool FairQueue::Raise(const Task& task) {
  if (!places_.contains(&task)) return false;
  Places places = PlacesOf(task);
  bool raised = false;
  for (Place& place : places) {
    Level& level = *place.flow->level;
    if (level.priority == Priority::kHigh) continue;
    const std::string client = place.flow->client;
    const Priority asked = place.asked;
    Item item = TakeOut(place);
    Settle(level);
    place =
        Put(std::move(item.task), place.lane, Priority(size_t(level.priority) - 1), client, item.cost_ms, item.further);
    place.asked = asked;
    raised = true;
  }
  if (raised) SetPlaces(task, std::move(places));
  return raised;
}

void FairQueue::Move(const Task& task, size_t lane) {
  Places places = PlacesOf(task);
  for (Place& place : places) {
    const Priority asked = place.asked, priority = place.flow->level->priority;
    const std::string client = place.flow->client;
    Item item = TakeOut(place);
    place = Put(std::move(item.task), lane, priority, client, item.cost_ms, item.further);
    place.asked = asked;
  }
  SetPlaces(task, std::move(places));
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
  // Every other client gets as much as this one, as far as it has work; every other priority in proportion to its
  // weight.
  const double clients = double(level.clients + (waits ? 0 : 1));
  const double here = std::min(level.waiting_ms, clients * (own + cost_ms));
  double ahead = here;
  for (const Level& other : levels_) {
    if (&other != &level) ahead += std::min(other.waiting_ms, (here + cost_ms) * other.weight / level.weight);
  }
  return ahead;
}

}  // namespace voxelpipe
