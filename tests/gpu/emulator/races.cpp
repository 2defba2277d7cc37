#include "cuda_emulator.h"

#include <dlfcn.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <unordered_map>
#include <vector>

// The program's own static memory, where translate.py puts what blocks share.
extern char __data_start, _end;

namespace cuda_emulator::races {
namespace {

// A block of this kernel or of an earlier one, and a thread of it.
using BlockName = std::pair<uint32_t, uint32_t>;
using ThreadName = std::pair<BlockName, unsigned>;

// The accesses of others that fences order before a thread: per block up to a barrier, per thread up to a clock.
struct Knowledge {
  std::map<BlockName, uint32_t> phases;
  std::map<ThreadName, uint32_t> clocks;
};
using Known = std::shared_ptr<const Knowledge>;

Known Join(const Known& a, const Known& b) {
  if (a == b || b == nullptr) return a;
  if (a == nullptr) return b;
  auto both = std::make_shared<Knowledge>(*a);
  for (const auto& [block, phase] : b->phases) both->phases[block] = std::max(both->phases[block], phase);
  for (const auto& [thread, clock] : b->clocks) both->clocks[thread] = std::max(both->clocks[thread], clock);
  return both;
}

struct Access {
  const void* code = nullptr;
  uint32_t kernel = 0;  // 0: there was none
  uint32_t block = 0, phase = 0, clock = 0;
  uint16_t thread = 0;
  uint8_t bytes = 0;  // of a word, a bit each
  bool relaxed = false;
};

// Of four bytes: the last writes, plain and relaxed, and reads since.
struct Word {
  static constexpr int kReads = 4;
  std::array<Access, 2> writes;
  std::array<Access, kReads> reads;
  uint8_t next_read = 0;
};

struct Thread {
  uint32_t clock = 1, knows_kernel = 0;
  bool awaited = false, allowed = false;
  std::array<uint32_t, 32> of_warp{};  // clocks of its warp's lanes up to which it knows what they did
  Known others, fenced;                // now; and with what it did itself, at its last fence
};

class Races;
Races& races();

class Races {
 public:
  Races() {
    std::atexit([] {
      std::fflush(stdout);
      if (races().Report()) std::_Exit(9);
    });
  }

  void BeginKernel(bool early) {
    ++kernel_;
    early_ = early;
    known_at_begin_ = early ? known_to_next_ : kernel_ - 1;
    known_to_next_ = kernel_ - 1;
    if (early) return;
    sync_.clear();
    words_.clear();  // all of it is known
  }

  void BeginBlock(uint32_t block, unsigned threads, const void* shared, size_t shared_bytes) {
    block_ = block;
    phase_ = 1;
    shared_ = static_cast<const char*>(shared);
    shared_end_ = shared_ + shared_bytes;
    threads_.assign(threads, Thread());
    for (Thread& t : threads_) t.knows_kernel = known_at_begin_;
    shared_sync_.clear();
    shared_words_.clear();
  }

  void SwitchTo(unsigned thread, const void* stack, size_t stack_bytes) {
    running_ = &threads_[thread];
    thread_ = thread;
    stack_ = static_cast<const char*>(stack);
    stack_end_ = stack_ + stack_bytes;
  }

  void EndBlock() {
    for (const Thread& t : threads_) {
      if (!t.allowed) known_to_next_ = std::min(known_to_next_, t.knows_kernel);
      if (early_ && !t.awaited)
        Tell("a kernel that begins early has threads that never wait for the one before", nullptr, nullptr);
    }
    running_ = nullptr;
  }

  void Barrier() {
    ++phase_;
    Known all;
    for (const Thread& t : threads_) all = Join(all, t.others);
    for (Thread& t : threads_) t.others = all;
  }

  void JoinWarp(unsigned warp, uint32_t lanes) {
    Known all;
    std::array<uint32_t, 32> clocks{};
    ForLanes(warp, lanes, [&](unsigned lane, Thread& t) {
      all = Join(all, t.others);
      for (unsigned i = 0; i < 32; ++i) clocks[i] = std::max(clocks[i], t.of_warp[i]);
      clocks[lane] = std::max(clocks[lane], t.clock);
    });
    ForLanes(warp, lanes, [&](unsigned, Thread& t) {
      t.others = all;
      t.of_warp = clocks;
      ++t.clock;
    });
  }

  void Fence() {
    auto knows = std::make_shared<Knowledge>(running_->others ? *running_->others : Knowledge());
    const BlockName mine(kernel_, block_);
    uint32_t& phase = knows->phases[mine];
    phase = std::max(phase, phase_);
    const unsigned warp = thread_ / 32 * 32;
    for (unsigned i = 0; i < 32; ++i) {
      if (running_->of_warp[i] > 0) Raise(knows->clocks[{mine, warp + i}], running_->of_warp[i]);
    }
    Raise(knows->clocks[{mine, thread_}], running_->clock);
    running_->fenced = knows;
    ++running_->clock;
  }

  void Relaxed(const void* at, size_t bytes, bool writes, const void* code) {
    if (running_ == nullptr || IsOwn(at)) return;
    Known& there = (IsShared(at) ? shared_sync_ : sync_)[at];
    running_->others = Join(running_->others, there);
    if (writes) there = Join(there, running_->fenced);
    Touch(at, bytes, writes, true, code);
  }
  // Who sees it does not see what the word told before.
  void Volatile(const void* at, size_t bytes, bool writes, const void* code) {
    if (!writes) return Relaxed(at, bytes, false, code);
    if (running_ == nullptr || IsOwn(at)) return;
    (IsShared(at) ? shared_sync_ : sync_)[at] = running_->fenced;
    Touch(at, bytes, true, true, code);
  }

  void Plain(const void* at, size_t bytes, bool writes, const void* code) {
    if (running_ == nullptr || IsOwn(at)) return;
    Touch(at, bytes, writes, false, code);
  }

  void AwaitEarlier() {
    running_->awaited = true;
    running_->knows_kernel = kernel_ - 1;
  }
  void AllowNext() {
    running_->allowed = true;
    known_to_next_ = std::min(known_to_next_, running_->knows_kernel);
  }

  size_t Forget() {
    const size_t count = found_.size();
    found_.clear();
    told_.clear();
    return count;
  }

  bool Report() const {
    for (const std::string& line : found_) std::fprintf(stderr, "%s\n", line.c_str());
    std::fprintf(stderr, "races: %zu places in %u kernels\n", found_.size(), kernel_);
    return !found_.empty();
  }

 private:
  template <typename Visit>
  void ForLanes(unsigned warp, uint32_t lanes, Visit&& visit) {
    for (unsigned lane = 0; lane < 32; ++lane) {
      if ((lanes >> lane & 1) != 0) visit(lane, threads_[warp * 32 + lane]);
    }
  }
  static void Raise(uint32_t& value, uint32_t least) { value = std::max(value, least); }

  // The thread's stack, or its number and its block's.
  bool IsOwn(const void* at) const {
    return (at >= stack_ && at < stack_end_) || (at >= &built_in && at < &built_in + 1);
  }
  bool IsShared(const void* at) const {
    return (at >= shared_ && at < shared_end_) || (at >= &__data_start && at < &_end);
  }

  // True if the running thread is ordered after an access of another one.
  bool Knows(const Access& a) const {
    const Thread& me = *running_;
    if (a.kernel != kernel_ && a.kernel <= me.knows_kernel) return true;
    if (a.kernel == kernel_ && a.block == block_) {
      if (a.thread == thread_ || a.phase < phase_) return true;
      if (a.thread / 32 == thread_ / 32 && a.clock <= me.of_warp[a.thread % 32]) return true;
    }
    if (me.others == nullptr) return false;
    const BlockName block(a.kernel, a.block);
    const auto phase = me.others->phases.find(block);
    if (phase != me.others->phases.end() && a.phase < phase->second) return true;
    const auto clock = me.others->clocks.find({block, a.thread});
    return clock != me.others->clocks.end() && a.clock <= clock->second;
  }

  void Touch(const void* at, size_t bytes, bool writes, bool relaxed, const void* code) {
    auto begin = reinterpret_cast<uintptr_t>(at);
    const uintptr_t end = begin + bytes;
    const bool shared = IsShared(at);
    Access a;
    a.code = code;
    a.kernel = kernel_;
    a.block = block_;
    a.phase = phase_;
    a.clock = running_->clock;
    a.thread = uint16_t(thread_);
    a.relaxed = relaxed;
    while (begin < end) {
      const uintptr_t word = begin & ~uintptr_t{3}, upto = std::min(end, word + 4);
      a.bytes = uint8_t((1u << (upto - word)) - (1u << (begin - word)));
      Touch(shared ? shared_words_[word] : words_[word], a, writes, shared);
      begin = upto;
    }
  }

  void Touch(Word& word, const Access& a, bool writes, bool shared) {
    const auto check = [&](const Access& earlier, const char* what) {
      if (earlier.kernel == 0 || (earlier.bytes & a.bytes) == 0 || (earlier.relaxed && a.relaxed) || Knows(earlier))
        return;
      std::string line = shared ? "shared memory: " : "global memory: ";
      line += writes ? "written" : "read";
      line += a.relaxed ? " (relaxed)" : "";
      line += std::string(what) + (earlier.relaxed ? " (relaxed)" : "");
      if (earlier.kernel != a.kernel) line += " by an earlier kernel";
      Tell(line, a.code, earlier.code);
    };
    for (const Access& write : word.writes) check(write, ", written before");
    if (writes) {
      for (const Access& read : word.reads) check(read, ", read before");
      word.writes[a.relaxed] = a;
      return;
    }
    for (Access& read : word.reads) {
      if (read.kernel != 0 && (read.relaxed != a.relaxed || read.bytes != a.bytes || !Knows(read))) continue;
      read = a;
      return;
    }
    word.reads[word.next_read++ % Word::kReads] = a;
  }

  // File and line of an access, and of the calls it was inlined from.
  static std::string PlaceOf(const void* code) {
    Dl_info info{};
    if (code == nullptr || dladdr(code, &info) == 0) return "";
    char command[4096 + 64], line[512];
    std::snprintf(command, sizeof command, "addr2line -s -i -e '%s' 0x%zx", info.dli_fname,
                  size_t(static_cast<const char*>(code) - static_cast<const char*>(info.dli_fbase)) - 1);
    std::string place;
    FILE* const lines = popen(command, "r");
    while (lines != nullptr && std::fgets(line, sizeof line, lines) != nullptr) {
      place += place.empty() ? "" : " < ";
      place.append(line, std::strcspn(line, " \n"));
    }
    if (lines != nullptr) pclose(lines);
    return place;
  }
  void Tell(const std::string& what, const void* here, const void* earlier) {
    if (!told_.insert({what, here, earlier}).second) return;
    found_.insert("race: " + what + "\n  " + PlaceOf(here) + "\n  " + PlaceOf(earlier));
  }

  uint32_t kernel_ = 0, known_at_begin_ = 0, known_to_next_ = 0;
  bool early_ = false;
  uint32_t block_ = 0, phase_ = 1;
  std::vector<Thread> threads_;
  // Of the host's thread that runs the kernel; others are no business of a kernel's.
  static inline thread_local Thread* running_ = nullptr;
  unsigned thread_ = 0;
  const char *stack_ = nullptr, *stack_end_ = nullptr, *shared_ = nullptr, *shared_end_ = nullptr;
  std::unordered_map<uintptr_t, Word> words_, shared_words_;
  std::unordered_map<const void*, Known> sync_, shared_sync_;  // the knowledge of readers of a value written there
  std::set<std::tuple<std::string, const void*, const void*>> told_;
  std::set<std::string> found_;
};

Races& races() {
  // Never destroyed: it tells at the program's end.
  static auto* const all = new Races;
  return *all;
}

}  // namespace

void BeginKernel(bool early) {
  races().BeginKernel(early);
}
void BeginBlock(uint32_t block, unsigned threads, const void* shared, size_t shared_bytes) {
  races().BeginBlock(block, threads, shared, shared_bytes);
}
void SwitchTo(unsigned thread, const void* stack, size_t stack_bytes) {
  races().SwitchTo(thread, stack, stack_bytes);
}
void EndBlock() {
  races().EndBlock();
}
void Barrier() {
  races().Barrier();
}
void JoinWarp(unsigned warp, uint32_t lanes) {
  races().JoinWarp(warp, lanes);
}
void Fence() {
  races().Fence();
}
void Relaxed(const void* at, size_t bytes, bool writes, const void* code) {
  races().Relaxed(at, bytes, writes, code);
}
void Volatile(const void* at, size_t bytes, bool writes, const void* code) {
  races().Volatile(at, bytes, writes, code);
}
void AwaitEarlier() {
  races().AwaitEarlier();
}
void AllowNext() {
  races().AllowNext();
}

size_t Forget() {
  return races().Forget();
}

void Plain(const void* at, size_t bytes, bool writes, const void* code) {
  races().Plain(at, bytes, writes, code);
}

}  // namespace cuda_emulator::races

// What the compiler calls before each access, by its interface for ThreadSanitizer.
#define ACCESS(name, bytes, kind, writes)                                         \
  extern "C" void __tsan_##name##bytes(void* at) {                                \
    ::cuda_emulator::races::kind(at, bytes, writes, __builtin_return_address(0)); \
  }
#define ACCESSES(bytes)                         \
  ACCESS(read, bytes, Plain, false)             \
  ACCESS(write, bytes, Plain, true)             \
  ACCESS(unaligned_read, bytes, Plain, false)   \
  ACCESS(unaligned_write, bytes, Plain, true)   \
  ACCESS(volatile_read, bytes, Volatile, false) \
  ACCESS(volatile_write, bytes, Volatile, true)
ACCESSES(1)
ACCESSES(2)
ACCESSES(4)
ACCESSES(8)
ACCESSES(16)
extern "C" {
void __tsan_read_range(void* at, size_t bytes) {
  ::cuda_emulator::races::Plain(at, bytes, false, __builtin_return_address(0));
}
void __tsan_write_range(void* at, size_t bytes) {
  ::cuda_emulator::races::Plain(at, bytes, true, __builtin_return_address(0));
}
// Of the host's own code beside the kernels.
char __tsan_atomic8_load(const volatile char* at, int) {
  return __atomic_load_n(at, __ATOMIC_SEQ_CST);
}
int __tsan_atomic32_load(const volatile int* at, int) {
  return __atomic_load_n(at, __ATOMIC_SEQ_CST);
}
void __tsan_atomic32_store(volatile int* at, int value, int) {
  __atomic_store_n(at, value, __ATOMIC_SEQ_CST);
}
int __tsan_atomic32_fetch_add(volatile int* at, int value, int) {
  return __atomic_fetch_add(at, value, __ATOMIC_SEQ_CST);
}
void __tsan_vptr_update(void*, void*) {}
void __tsan_init() {}
void __tsan_func_entry(void*) {}
void __tsan_func_exit() {}
}
