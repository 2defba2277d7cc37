// What oneTBB orders between threads, told to ThreadSanitizer, which cannot see it: its queues of tasks are in a
// library that Debian compiles without it. A task sees what was done before it was spawned, who waits sees what the
// tasks did, and memory for tasks changes hands in order. Nothing of this is in a build without ThreadSanitizer.
#include <oneapi/tbb/detail/_task.h>
#include <oneapi/tbb/task_arena.h>

#include "support/tsan/pass_through.h"

namespace {

namespace d1 = tbb::detail::d1;
using voxelpipe::tsan::Acquire;
using voxelpipe::tsan::Library;
using voxelpipe::tsan::Release;

#define R1 "_ZN3tbb6detail2r1"

// Takes a task's place where it was spawned.
class OrderedTask final : public d1::task {
 public:
  explicit OrderedTask(d1::task& inner) : inner_(inner) { Release(&inner_); }

  d1::task* execute(d1::execution_data& data) override {
    Acquire(&inner_);
    d1::task* const next = inner_.execute(data);  // after a throw comes cancel
    delete this;
    return next;
  }
  d1::task* cancel(d1::execution_data& data) override {
    Acquire(&inner_);
    d1::task* const next = inner_.cancel(data);
    delete this;
    return next;
  }

 private:
  d1::task& inner_;
};

// What an arena executes, perhaps on another thread than the one that waits for it.
class OrderedDelegate final : public d1::delegate_base {
 public:
  explicit OrderedDelegate(d1::delegate_base& inner) : inner_(inner) { Release(&inner_); }
  ~OrderedDelegate() override { Acquire(&inner_); }

  bool operator()() const override {
    Acquire(&inner_);
    const bool done = inner_();
    Release(&inner_);
    return done;
  }

 private:
  d1::delegate_base& inner_;
};

// The last task that ends counts this down in code of ours, the one who waits reads it in the library.
void AcquireCount(d1::wait_context& wait) {
  static_assert(sizeof(wait) == 2 * sizeof(uint64_t), "the count comes second");
  Acquire(reinterpret_cast<uint64_t*>(&wait) + 1);
}

}  // namespace

namespace tbb::detail::r1 {

void spawn(d1::task& task, d1::task_group_context& context) {
  static auto* const library =
      Library<void(d1::task&, d1::task_group_context&)>(R1 "5spawnERNS0_2d14taskERNS2_18task_group_contextE");
  library(*new OrderedTask(task), context);
}

void spawn(d1::task& task, d1::task_group_context& context, d1::slot_id slot) {
  static auto* const library = Library<void(d1::task&, d1::task_group_context&, d1::slot_id)>(
      R1 "5spawnERNS0_2d14taskERNS2_18task_group_contextEt");
  library(*new OrderedTask(task), context, slot);
}

void execute_and_wait(d1::task& task, d1::task_group_context& task_context, d1::wait_context& wait,
                      d1::task_group_context& wait_context) {
  static auto* const library =
      Library<void(d1::task&, d1::task_group_context&, d1::wait_context&, d1::task_group_context&)>(
          R1 "16execute_and_waitERNS0_2d14taskERNS2_18task_group_contextERNS2_12wait_contextES6_");
  try {
    library(task, task_context, wait, wait_context);
  } catch (...) {
    AcquireCount(wait);
    throw;
  }
  AcquireCount(wait);
}

void execute(d1::task_arena_base& arena, d1::delegate_base& delegate) {
  static auto* const library = Library<void(d1::task_arena_base&, d1::delegate_base&)>(
      R1 "7executeERNS0_2d115task_arena_baseERNS2_13delegate_baseE");
  OrderedDelegate ordered(delegate);
  library(arena, ordered);
}

void* allocate(d1::small_object_pool*& pool, size_t bytes) {
  static auto* const library =
      Library<void*(d1::small_object_pool*&, size_t)>(R1 "8allocateERPNS0_2d117small_object_poolEm");
  void* const memory = library(pool, bytes);
  Acquire(memory);
  return memory;
}

void* allocate(d1::small_object_pool*& pool, size_t bytes, const d1::execution_data& data) {
  static auto* const library = Library<void*(d1::small_object_pool*&, size_t, const d1::execution_data&)>(
      R1 "8allocateERPNS0_2d117small_object_poolEmRKNS2_14execution_dataE");
  void* const memory = library(pool, bytes, data);
  Acquire(memory);
  return memory;
}

void deallocate(d1::small_object_pool& pool, void* memory, size_t bytes) {
  static auto* const library =
      Library<void(d1::small_object_pool&, void*, size_t)>(R1 "10deallocateERNS0_2d117small_object_poolEPvm");
  Release(memory);
  library(pool, memory, bytes);
}

void deallocate(d1::small_object_pool& pool, void* memory, size_t bytes, const d1::execution_data& data) {
  static auto* const library = Library<void(d1::small_object_pool&, void*, size_t, const d1::execution_data&)>(
      R1 "10deallocateERNS0_2d117small_object_poolEPvmRKNS2_14execution_dataE");
  Release(memory);
  library(pool, memory, bytes, data);
}

}  // namespace tbb::detail::r1
