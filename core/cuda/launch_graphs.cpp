#include "cuda/launch_graphs.h"

#include <algorithm>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "cuda/check.h"
#include "cuda/launch_list.h"

namespace voxelpipe::cuda {
namespace {

constexpr size_t kMostKept = 64;  // graphs, and lists that came once, of a device
constexpr size_t kMostHeld = 8;   // of a run

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
      (void)cudaGetLastError();
      return CudaStatus(error, absl::StrCat("launch of ", launch.name).c_str(), __FILE__, __LINE__);
    }
  }
  return absl::OkStatus();
}

}  // namespace

class LaunchGraph {
 public:
  // Null where the device or its driver cannot.
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

  // From now on it launches `list`, one like its own. False where that is refused; then it is of no use.
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
  absl::Status Launch(cudaStream_t stream) const {
    VOXELPIPE_CUDA_OR_RETURN(cudaGraphLaunch(executable_, stream));
    for (size_t i = 0; i < nodes_.size(); ++i) CountLaunch();
    return absl::OkStatus();
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

  LaunchList list_;  // with the arguments that the executable graph has
  cudaGraph_t graph_ = nullptr;
  cudaGraphExec_t executable_ = nullptr;
  std::vector<cudaGraphNode_t> nodes_;
};

namespace {

// Graphs of a device that no run uses, the latest last, and lists that came once.
struct Kept {
  std::deque<std::unique_ptr<LaunchGraph>> graphs;
  std::deque<LaunchList> once;
};
std::mutex kept_mutex;
std::map<int, Kept>& KeptGraphs() {
  static auto* const kept = new std::map<int, Kept>;  // never destroyed: the driver may end before static objects do
  return *kept;
}

std::unique_ptr<LaunchGraph> TakeKept(const LaunchList& list, int ordinal) {
  const std::lock_guard lock(kept_mutex);
  auto& graphs = KeptGraphs()[ordinal].graphs;
  const auto found = std::find_if(graphs.begin(), graphs.end(), [&](const auto& g) { return g->list().IsLike(list); });
  if (found == graphs.end()) return nullptr;
  std::unique_ptr<LaunchGraph> taken = std::move(*found);
  graphs.erase(found);
  return taken;
}

// Whether a list like it came before; it has come now.
bool CameBefore(const LaunchList& list, int ordinal) {
  const std::lock_guard lock(kept_mutex);
  auto& once = KeptGraphs()[ordinal].once;
  const auto found = std::find_if(once.begin(), once.end(), [&](const LaunchList& l) { return l.IsLike(list); });
  if (found != once.end()) return true;
  if (once.size() == kMostKept) once.pop_front();
  once.push_back(list);
  return false;
}

void Keep(std::unique_ptr<LaunchGraph> graph, int ordinal) {
  std::unique_ptr<LaunchGraph> dropped;  // outside of the lock
  const std::lock_guard lock(kept_mutex);
  auto& graphs = KeptGraphs()[ordinal].graphs;
  if (graphs.size() == kMostKept) {
    dropped = std::move(graphs.front());
    graphs.pop_front();
  }
  graphs.push_back(std::move(graph));
}

}  // namespace

LaunchGraphs::LaunchGraphs() = default;

LaunchGraphs::~LaunchGraphs() {
  for (auto& graph : mine_) Keep(std::move(graph), ordinal_);
}

LaunchGraph* LaunchGraphs::Find(const LaunchList& list, int ordinal) {
  for (auto& graph : mine_) {
    if (graph->list().IsLike(list)) return graph.get();
  }
  std::unique_ptr<LaunchGraph> graph = TakeKept(list, ordinal);
  if (graph == nullptr && CameBefore(list, ordinal)) graph = LaunchGraph::Make(list);
  if (graph == nullptr) return nullptr;
  ordinal_ = ordinal;
  if (mine_.size() == kMostHeld) {
    Keep(std::move(mine_.front()), ordinal);
    mine_.erase(mine_.begin());
  }
  mine_.push_back(std::move(graph));
  return mine_.back().get();
}

absl::Status LaunchGraphs::Launch(const LaunchList& list, int ordinal, cudaStream_t stream) {
  const auto launches = list.launches();
  if (launches.empty()) return absl::OkStatus();
  if (launches[0].begins == Begins::kEarly) return LaunchPlainly(list, stream);
  LaunchGraph* const graph = Find(list, ordinal);
  if (graph == nullptr) return LaunchPlainly(list, stream);
  if (graph->Take(list)) return graph->Launch(stream);
  std::erase_if(mine_, [graph](const auto& g) { return g.get() == graph; });
  return LaunchPlainly(list, stream);
}

void DropLaunchGraphs(int ordinal) {
  std::deque<std::unique_ptr<LaunchGraph>> dropped;
  const std::lock_guard lock(kept_mutex);
  dropped = std::exchange(KeptGraphs()[ordinal].graphs, {});
}

}  // namespace voxelpipe::cuda
