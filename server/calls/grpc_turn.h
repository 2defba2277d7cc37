// What gRPC orders, told to ThreadSanitizer, which cannot see it: Debian's gRPC is not instrumented and hands calls from thread to
// thread without locks. Nothing without the sanitizer.
#pragma once

namespace voxelpipe {

#if defined(__SANITIZE_THREAD__)
extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);
#define VOXELPIPE_TSAN(action, place) __tsan_##action(const_cast<void*>(static_cast<const void*>(place)))
#else
#define VOXELPIPE_TSAN(action, place) static_cast<void>(place)
#endif

// What our reactors answer to gRPC's InternalInlineable: OnCancel and OnDone never wait, and so gRPC need not hand them over to one more
// thread.
inline constexpr bool kReactAtOnce = true;

// Before an operation is started: what was done until here is seen by the reaction to it, whose GrpcTurn begins at the same place.
// `place` is any object that stands for one kind of operation of one call, as the message that is read. No worker waits on a place, so
// that races between workers and reactions are still found.
inline void GiveToGrpc(const void* place) {
  VOXELPIPE_TSAN(release, place);
}

// A reaction of a call, for as long as the object lives.
class GrpcTurn {
 public:
  // `begin`: where GiveToGrpc was; `end`: the call, whose OnDone comes after all its other reactions.
  GrpcTurn(const void* begin, const void* end) : end_(end) { VOXELPIPE_TSAN(acquire, begin); }
  ~GrpcTurn() { VOXELPIPE_TSAN(release, end_); }
  GrpcTurn(const GrpcTurn&) = delete;
  GrpcTurn& operator=(const GrpcTurn&) = delete;

 private:
  const void* const end_;
};

// In OnDone: `call` is the end of all turns, `finish` the place of what ended the call.
inline void GrpcIsDone(const void* call, const void* finish) {
  VOXELPIPE_TSAN(acquire, call);
  VOXELPIPE_TSAN(acquire, finish);
}

}  // namespace voxelpipe
