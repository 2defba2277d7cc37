// The emulator's scheduler: the threads of a block take turns on one thread of the host.
#include <cstdio>
#include <mutex>
#include <random>
#include <vector>

#include "cuda_emulator.h"

namespace cuda_emulator {

Built built_in;

namespace {

constexpr size_t kStackBytes = 256 * 1024;

[[noreturn]] void Die(const char* what) {
  std::fprintf(stderr, "cuda emulator: %s (block %u,%u,%u thread %u)\n", what, built_in.block.x, built_in.block.y,
               built_in.block.z, built_in.thread.x);
  std::abort();
}

struct Fiber {
  enum State { kReady, kAtBarrier, kInWarp, kDone };
  State state = kReady;
  void* stack_pointer = nullptr;
  std::vector<char> stack = std::vector<char>(kStackBytes);
  // Of the last rendezvous.
  bool orders = false;
  uint32_t mask = 0;
  uint64_t value = 0;
  Lanes lanes{};
};

extern "C" void cuda_emulator_switch(void** from, void* to);
asm(R"(
.text
.globl cuda_emulator_switch
.type cuda_emulator_switch, @function
cuda_emulator_switch:
  pushq %rbp
  pushq %rbx
  pushq %r12
  pushq %r13
  pushq %r14
  pushq %r15
  movq %rsp, (%rdi)
  movq %rsi, %rsp
  popq %r15
  popq %r14
  popq %r13
  popq %r12
  popq %rbx
  popq %rbp
  ret
.size cuda_emulator_switch, . - cuda_emulator_switch
)");

class Block;
Block* running = nullptr;

class Block {
 public:
  Block(const Config& config, uint32_t number, const std::function<void()>& thread)
      : thread_(thread), dims_(config.block), count_(config.block.x * config.block.y * config.block.z) {
    if (count_ == 0 || count_ > 1024) Die("no block has so many threads");
    if (fibers_.size() < count_) fibers_.resize(count_);
    shared_.assign(config.shared + 16, char(0xcd));
    races::BeginBlock(number, count_, shared_.data(), shared_.size());
  }
  ~Block() { races::EndBlock(); }

  void Run() {
    running = this;
    for (unsigned i = 0; i < count_; ++i) Prepare(fibers_[i]);
    order_.resize(count_);
    for (unsigned i = 0; i < count_; ++i) order_[i] = i;
    if (shuffled()) std::shuffle(order_.begin(), order_.end(), random_);
    unsigned done = 0;
    while (done < count_) {
      bool moved = false;
      for (const unsigned i : order_) {
        if (fibers_[i].state != Fiber::kReady) continue;
        moved = true;
        current_ = i;
        built_in.thread = {i % dims_.x, i / dims_.x % dims_.y, i / dims_.x / dims_.y};
        races::SwitchTo(i, fibers_[i].stack.data(), kStackBytes);
        cuda_emulator_switch(&scheduler_, fibers_[i].stack_pointer);
        if (fibers_[i].state == Fiber::kDone) {
          ++done;
          Release(i / 32);
        }
      }
      if (!moved && done < count_) ReleaseBarrier(done);
    }
    running = nullptr;
  }

  Gathered Barrier(bool predicate) {
    Fiber& self = fibers_[current_];
    any_ = any_ || predicate;
    all_ = all_ && predicate;
    sum_ += predicate;
    self.state = Fiber::kAtBarrier;
    Yield(self);
    return gathered_;
  }

  const Lanes& Exchange(uint32_t mask, uint64_t value, bool orders) {
    Fiber& self = fibers_[current_];
    if ((mask >> current_ % 32 & 1) == 0) Die("a lane takes part in an exchange whose mask leaves it out");
    self.state = Fiber::kInWarp;
    self.mask = mask;
    self.value = value;
    self.orders = orders;
    Release(current_ / 32);
    if (self.state == Fiber::kInWarp) Yield(self);
    return self.lanes;
  }

  unsigned current() const { return current_; }
  void* shared() { return reinterpret_cast<void*>((reinterpret_cast<uintptr_t>(shared_.data()) + 15) / 16 * 16); }
  void Finish() {
    Fiber& self = fibers_[current_];
    self.state = Fiber::kDone;
    Yield(self);
  }
  void RunThread() { thread_(); }

 private:
  static bool shuffled() {
    static const bool wanted = std::getenv("CUDA_EMULATOR_SHUFFLE") != nullptr;
    return wanted;
  }

  static void Entry() {
    running->RunThread();
    running->Finish();
  }

  void Prepare(Fiber& fiber) {
    fiber.state = Fiber::kReady;
    auto top = reinterpret_cast<uintptr_t>(fiber.stack.data() + fiber.stack.size()) / 16 * 16;
    auto* slots = reinterpret_cast<void**>(top) - 8;
    for (int i = 0; i < 6; ++i) slots[i] = nullptr;  // registers
    slots[6] = reinterpret_cast<void*>(&Entry);      // leaves the stack as after a call
    slots[7] = nullptr;
    fiber.stack_pointer = slots;
  }

  void Yield(Fiber& self) {
    const dim3 thread = built_in.thread;
    const unsigned me = current_;
    cuda_emulator_switch(&self.stack_pointer, scheduler_);
    current_ = me;
    built_in.thread = thread;
  }

  // Completes exchanges of a warp all of whose lanes that still run have come.
  void Release(unsigned warp) {
    const unsigned begin = warp * 32, end = std::min(count_, begin + 32);
    uint32_t alive = 0;
    for (unsigned i = begin; i < end; ++i) alive |= uint32_t(fibers_[i].state != Fiber::kDone) << (i - begin);
    for (unsigned i = begin; i < end; ++i) {
      if (fibers_[i].state != Fiber::kInWarp) continue;
      const uint32_t mask = fibers_[i].mask;
      Lanes lanes{};
      for (unsigned j = begin; j < end; ++j) {
        if (fibers_[j].state != Fiber::kInWarp || fibers_[j].mask != mask) continue;
        lanes.came |= 1u << (j - begin);
        lanes.value[j - begin] = fibers_[j].value;
      }
      if (lanes.came != (mask & alive)) continue;
      if (fibers_[i].orders) races::JoinWarp(warp, lanes.came);
      for (unsigned j = begin; j < end; ++j) {
        if ((lanes.came >> (j - begin) & 1) == 0) continue;
        fibers_[j].lanes = lanes;
        fibers_[j].state = Fiber::kReady;
      }
    }
  }

  void ReleaseBarrier(unsigned done) {
    unsigned waiting = 0;
    for (unsigned i = 0; i < count_; ++i) waiting += fibers_[i].state == Fiber::kAtBarrier;
    if (waiting + done != count_) Die("a lane waits for others of its warp that wait at a barrier or not at all");
    races::Barrier();
    gathered_ = {any_, all_, sum_};
    any_ = false;
    all_ = true;
    sum_ = 0;
    for (unsigned i = 0; i < count_; ++i) {
      if (fibers_[i].state == Fiber::kAtBarrier) fibers_[i].state = Fiber::kReady;
    }
  }

  static inline std::vector<Fiber> fibers_;  // stacks are used again
  static inline std::vector<char> shared_;
  static inline std::mt19937 random_;

  const std::function<void()>& thread_;
  const dim3 dims_;
  const unsigned count_;
  std::vector<unsigned> order_;
  void* scheduler_ = nullptr;
  unsigned current_ = 0;
  bool any_ = false, all_ = true;
  int sum_ = 0;
  Gathered gathered_{};
};

}  // namespace

void RunKernel(const Config& config, const std::function<void()>& thread) {
  static std::mutex one_at_a_time;  // of the host's threads: what is built in and what blocks share are static
  const std::lock_guard lock(one_at_a_time);
  built_in.grid_dim = config.grid;
  built_in.block_dim = config.block;
  if (config.grid.x == 0 || config.grid.y == 0 || config.grid.z == 0) Die("a grid without blocks");
  races::BeginKernel(config.early);
  uint32_t number = 0;
  for (unsigned z = 0; z < config.grid.z; ++z) {
    for (unsigned y = 0; y < config.grid.y; ++y) {
      for (unsigned x = 0; x < config.grid.x; ++x) {
        built_in.block = {x, y, z};
        Block(config, number++, thread).Run();
      }
    }
  }
}

void* DynamicShared() {
  return running->shared();
}
Gathered BlockBarrier(bool predicate) {
  return running->Barrier(predicate);
}
const Lanes& WarpExchange(uint32_t mask, uint64_t value, bool orders) {
  return running->Exchange(mask, value, orders);
}
unsigned Lane() {
  return running->current() % 32;
}

}  // namespace cuda_emulator
