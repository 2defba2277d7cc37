// What our reactors declare to gRPC.
#pragma once

namespace voxelpipe {

// The answer to gRPC's InternalInlineable: OnCancel and OnDone never wait, so they need not be handed to one more
// thread.
inline constexpr bool kReactAtOnce = true;

}  // namespace voxelpipe
