// What gRPC and Abseil order between threads, told to ThreadSanitizer. Debian compiles them without it, so that it sees
// none of their locks and queues: they wait by futex and hand work on by atomic operations. Only the order that these
// functions really guarantee is annotated, so races in our code are still found, also within reactors and callbacks.
// Builds without ThreadSanitizer contain none of this.
#include <atomic>

#include <grpcpp/support/server_callback.h>

#include "support/tsan/pass_through.h"

namespace {

using voxelpipe::tsan::Acquire;
using voxelpipe::tsan::Release;

// Arguments and results of all functions here are integers and pointers, six words at most, or a class that the calling
// convention passes as such.
using Word = long;
using Function = Word(Word, Word, Word, Word, Word, Word);

// Both directions, as an atomic read-modify-write in the function has it.
void AcquireAndRelease(Word place) {
  Acquire(place);
  Release(place);
}

}  // namespace

// Defines `symbol`: `before`, the library's function, `after`. These see the arguments a to f and the result r.
#define PASS_THROUGH(symbol, before, after) PASS_THROUGH_AS(__COUNTER__, symbol, before, after)
#define PASS_THROUGH_AS(number, symbol, before, after) PASS_THROUGH_NAMED(number, symbol, before, after)
#define PASS_THROUGH_NAMED(number, symbol, before, after)                                     \
  extern "C" Word PassThrough##number(Word, Word, Word, Word, Word, Word) __asm__(symbol);    \
  extern "C" Word PassThrough##number(Word a, Word b, Word c, Word d, Word e, Word f) {       \
    static std::atomic<Function*> library;                                                    \
    Function* function = library.load(std::memory_order_relaxed);                             \
    if (function == nullptr) library = function = voxelpipe::tsan::Library<Function>(symbol); \
    before;                                                                                   \
    const Word r = function(a, b, c, d, e, f);                                                \
    after;                                                                                    \
    return r;                                                                                 \
  }

// Locks. A wait gives its mutex back meanwhile.
#define ABSL "_ZN4absl7debian3"
PASS_THROUGH(ABSL "5Mutex4LockEv", , Acquire(a))
PASS_THROUGH(ABSL "5Mutex10ReaderLockEv", , Acquire(a))
PASS_THROUGH(ABSL "5Mutex7TryLockEv", , if (r & 0xff) Acquire(a))
PASS_THROUGH(ABSL "5Mutex6UnlockEv", Release(a), )
PASS_THROUGH(ABSL "5Mutex12ReaderUnlockEv", Release(a), )
PASS_THROUGH(ABSL "7CondVar4WaitEPNS0_5MutexE", Release(b), Acquire(b))
PASS_THROUGH(ABSL "7CondVar15WaitWithTimeoutEPNS0_5MutexENS0_8DurationE", Release(b), Acquire(b))
PASS_THROUGH(ABSL "7CondVar16WaitWithDeadlineEPNS0_5MutexENS0_4TimeE", Release(b), Acquire(b))
PASS_THROUGH("gpr_event_set", Release(a), )
PASS_THROUGH("gpr_event_get", , Acquire(a))
PASS_THROUGH("gpr_event_wait", , Acquire(a))

// Queues: who takes a node sees what was done before it was put in, and so does who puts in the next.
#define CORE "_ZN9grpc_core"
PASS_THROUGH(CORE "32MultiProducerSingleConsumerQueue4PushEPNS0_4NodeE", AcquireAndRelease(a); Release(b), )
PASS_THROUGH(CORE "32MultiProducerSingleConsumerQueue3PopEv", , if (r) Acquire(r))
PASS_THROUGH(CORE "32MultiProducerSingleConsumerQueue14PopAndCheckEndEPb", , if (r) Acquire(r))

// The counters that decide which thread does the work of a call or of a connection, and which step ends a batch of
// operations.
PASS_THROUGH(CORE "12CallCombiner5StartEP12grpc_closureN4absl7debian36StatusEPKciS7_", AcquireAndRelease(a), )
PASS_THROUGH(CORE "12CallCombiner4StopEPKciS2_", AcquireAndRelease(a), )
PASS_THROUGH(CORE "12CallCombiner6CancelEN4absl7debian36StatusE", AcquireAndRelease(a), )
PASS_THROUGH(CORE "12CallCombiner17SetNotifyOnCancelEP12grpc_closure", AcquireAndRelease(a), )
PASS_THROUGH(CORE "8Combiner3RunEP12grpc_closureN4absl7debian36StatusE", AcquireAndRelease(a), )
PASS_THROUGH(CORE "8Combiner10FinallyRunEP12grpc_closureN4absl7debian36StatusE", AcquireAndRelease(a), )
PASS_THROUGH(CORE "15FilterStackCall12BatchControl10FinishStepEv", AcquireAndRelease(a), )

// Of a call's references some are dropped in the library, the others in code of ours; after the last comes the end of
// the call.
constexpr Word kReferencesAt = sizeof(void*) + sizeof(int);
static_assert(sizeof(grpc::internal::ServerCallbackCall) == kReferencesAt + sizeof(int), "the references come last");
PASS_THROUGH("_ZN4grpc8internal18ServerCallbackCall14ScheduleOnDoneEb", Acquire(a + kReferencesAt), )
