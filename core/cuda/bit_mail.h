// Room for the mail of bit_mail.cuh. No host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

inline constexpr uint32_t kMailWords = 8;  // of a box
inline constexpr uint32_t kMailBoxes = 8;  // for each multiprocessor

}  // namespace voxelpipe::cuda
