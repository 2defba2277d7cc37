// Builds CUDA graphs from kernel lists, updates their arguments, and caches them per device.
#include "cuda/device/graph_cache.h"

#include <algorithm>
#include <list>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "cuda/device/check.h"
#include "cuda/device/kernel_list.h"

namespace voxelpipe::cuda {
namespace {

constexpr size_t kMaxKept = 64;  // graphs kept per device, and lists seen once
constexpr size_t kMaxHeld = 8;   // graphs held per run

absl::Status LaunchPlainly(const LaunchList& list, cudaStream_t stream) {
  for (const ListedLaunch& launch : list.launches()) {
    cudaLaunchAttribute attribute{};
    if (launch.begins == Begins::kAtOnce) {
      attribute.id = cudaLaunchAttributeCooperative;
      attribute.val.cooperative = 1;
    } else {
      attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
      attribute.val.programmaticStreamSerializationAllowed = 1;
    }
    const unsigned attributes = launch.begins == Begins::kBehind ? 0 : 1;
    const cudaLaunchConfig_t config{launch.blocks, dim3(launch.threads), 0, stream, &attribute, attributes};
    CountLaunch();
    const cudaError_t error = launch.launch(config, launch.kernel, list.ArgumentsOf(launch).data());
    if (error != cudaSuccess) {
      return CudaStatus(error, absl::StrCat("launch of ", launch.name).c_str(), __FILE__, __LINE__);
    }
  }
  return absl::OkStatus();
}

}  // namespace

class LaunchGraph {
 public:
  // Null if the device or its driver does not support it.
  static std::unique_ptr<LaunchGraph> Make(const LaunchList& list) {
    auto made = std::unique_ptr<LaunchGraph>(new LaunchGraph(list));
    if (made->Build()) return made;
    (void)cudaGetLastError();
    return nullptr;
  }
  LaunchGraph(const LaunchGraph&) = delete;
  LaunchGraph& operator=(const LaunchGraph&) = delete;
  ~LaunchGraph() {
    if (executable_ != nullptr) (void)cudaGraphExecDestroy(executable_);
    if (graph_ != nullptr) (void)cudaGraphDestroy(graph_);
  }

  const LaunchList& list() const { return list_; }

  // Updates the graph to the arguments of `list`, which must be like its own. False if CUDA refuses: the graph is then
  // unusable.
  bool Take(const LaunchList& list) {
    bool same = true;
    for (size_t i = 0; i < nodes_.size(); ++i) {
      if (list.HasArgumentsOf(list_, i)) continue;
      same = false;
      const ListedLaunch& launch = list.launches()[i];
      std::vector<void*> arguments = list.ArgumentsOf(launch);
      const cudaKernelNodeParams node = NodeOf(launch, arguments);
      if (cudaGraphExecKernelNodeSetParams(executable_, nodes_[i], &node) != cudaSuccess) {
        (void)cudaGetLastError();
        return false;
      }
    }
    if (!same) list_ = list;
    return true;
  }
  // False if CUDA refuses: nothing was launched.
  bool Launch(cudaStream_t stream) const {
    if (cudaGraphLaunch(executable_, stream) != cudaSuccess) {
      (void)cudaGetLastError();
      return false;
    }
    for (size_t i = 0; i < nodes_.size(); ++i) CountLaunch();
    return true;
  }

 private:
  explicit LaunchGraph(LaunchList list) : list_(std::move(list)) {}

  static cudaKernelNodeParams NodeOf(const ListedLaunch& launch, std::vector<void*>& arguments) {
    cudaKernelNodeParams node{};
    node.func = const_cast<void*>(launch.kernel);
    node.gridDim = launch.blocks;
    node.blockDim = dim3(launch.threads);
    node.kernelParams = arguments.data();
    return node;
  }

  bool Build() {
    if (cudaGraphCreate(&graph_, 0) != cudaSuccess) return false;
    for (const ListedLaunch& launch : list_.launches()) {
      if (!AddNode(launch)) return false;
    }
    return cudaGraphInstantiate(&executable_, graph_, 0) == cudaSuccess;
  }
  bool AddNode(const ListedLaunch& launch) {
    std::vector<void*> arguments = list_.ArgumentsOf(launch);
    const cudaKernelNodeParams params = NodeOf(launch, arguments);
    cudaGraphNode_t node = nullptr;
    if (cudaGraphAddKernelNode(&node, graph_, nullptr, 0, &params) != cudaSuccess) return false;
    if (launch.begins == Begins::kAtOnce) {
      cudaLaunchAttributeValue value{};
      value.cooperative = 1;
      if (cudaGraphKernelNodeSetAttribute(node, cudaLaunchAttributeCooperative, &value) != cudaSuccess) return false;
    }
    if (!nodes_.empty()) {
      cudaGraphEdgeData edge{};
      if (launch.begins == Begins::kEarly) {
        edge.from_port = cudaGraphKernelNodePortProgrammatic;
        edge.type = cudaGraphDependencyTypeProgrammatic;
      }
      if (cudaGraphAddDependencies(graph_, &nodes_.back(), &node, &edge, 1) != cudaSuccess) return false;
    }
    nodes_.push_back(node);
    return true;
  }

  LaunchList list_;  // with the arguments of the executable graph
  cudaGraph_t graph_ = nullptr;
  cudaGraphExec_t executable_ = nullptr;
  std::vector<cudaGraphNode_t> nodes_;
};

namespace {

// Graphs of a device that no run holds, most recent last, and lists seen once.
struct Kept {
  std::list<std::unique_ptr<LaunchGraph>> graphs;
  std::list<LaunchList> once;
  bool refused = false;  // the device or its driver refused to make one
};
std::mutex kept_mutex;
std::map<int, Kept>& KeptGraphs() {
  // Never destroyed: the driver may shut down before static objects do.
  static auto* const kept = new std::map<int, Kept>;
  return *kept;
}

// Moves the most recent kept graph for such a list to the front of `mine`. False if there is none.
bool TakeKept(const LaunchList& list, int ordinal, std::list<std::unique_ptr<LaunchGraph>>& mine) {
  const std::lock_guard lock(kept_mutex);
  auto& graphs = KeptGraphs()[ordinal].graphs;
  const auto found =
      std::find_if(graphs.rbegin(), graphs.rend(), [&](const auto& g) { return g->list().IsLike(list); });
  if (found == graphs.rend()) return false;
  mine.splice(mine.begin(), graphs, std::prev(found.base()));
  return true;
}

// True if a list like this one was seen before. Records it as seen.
bool IsWorthGraph(const LaunchList& list, int ordinal) {
  const std::lock_guard lock(kept_mutex);
  Kept& kept = KeptGraphs()[ordinal];
  if (kept.refused) return false;
  auto& once = kept.once;
  if (std::any_of(once.begin(), once.end(), [&](const LaunchList& l) { return l.IsLike(list); })) return true;
  if (once.size() == kMaxKept) once.pop_front();
  once.push_back(list);
  return false;
}

void Refused(int ordinal) {
  const std::lock_guard lock(kept_mutex);
  KeptGraphs()[ordinal].refused = true;
}

}  // namespace

LaunchGraphs::LaunchGraphs() = default;

LaunchGraphs::~LaunchGraphs() {
  std::list<std::unique_ptr<LaunchGraph>> dropped;  // destroyed outside the lock
  if (mine_.empty()) return;
  const std::lock_guard lock(kept_mutex);
  auto& graphs = KeptGraphs()[ordinal_].graphs;
  graphs.splice(graphs.end(), mine_);
  while (graphs.size() > kMaxKept) dropped.splice(dropped.end(), graphs, graphs.begin());
}

LaunchGraph* LaunchGraphs::Find(const LaunchList& list, int ordinal) {
  for (auto& graph : mine_) {
    if (graph->list().IsLike(list)) return graph.get();
  }
  ordinal_ = ordinal;
  if (!TakeKept(list, ordinal, mine_)) {
    if (!IsWorthGraph(list, ordinal)) return nullptr;
    std::unique_ptr<LaunchGraph> made = LaunchGraph::Make(list);
    if (made == nullptr) {
      Refused(ordinal);
      return nullptr;
    }
    mine_.push_front(std::move(made));
  }
  if (mine_.size() > kMaxHeld) mine_.pop_back();  // not returned to the cache: it may still be executing
  return mine_.front().get();
}

absl::Status LaunchGraphs::Launch(const LaunchList& list, int ordinal, cudaStream_t stream) {
  const auto launches = list.launches();
  if (launches.empty()) return absl::OkStatus();
  if (launches[0].begins == Begins::kEarly) return LaunchPlainly(list, stream);
  LaunchGraph* const graph = Find(list, ordinal);
  if (graph != nullptr) {
    if (graph->Take(list) && graph->Launch(stream)) return absl::OkStatus();
    mine_.remove_if([graph](const auto& g) { return g.get() == graph; });
  }
  return LaunchPlainly(list, stream);
}

void DropLaunchGraphs(int ordinal) {
  Kept dropped;  // destroyed outside the lock
  const std::lock_guard lock(kept_mutex);
  std::swap(dropped, KeptGraphs()[ordinal]);
}

}  // namespace voxelpipe::cuda
