// The declaration of our reactors to gRPC.
#pragma once

namespace voxelpipe {

// The result of gRPC's InternalInlineable: OnCancel and OnDone never block, so they need no other thread.
inline constexpr bool kReactAtOnce = true;

}  // namespace voxelpipe
