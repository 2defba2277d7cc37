// The revision of the contract (proto/voxelpipe/v1) of which server and clients are made.
#pragma once

#include <cstdint>

namespace voxelpipe {

// GetServerInfoResponse.contract_revision; grows with each change of the contract.
inline constexpr int32_t kContractRevision = 2;

}  // namespace voxelpipe
