// Room for the mail of bit_mail.cuh. No host-only includes.
#pragma once

#include <cstdint>

namespace voxelpipe::cuda {

inline constexpr uint32_t kMailWords = 8;  // of a box
// Boxes for each multiprocessor: beside so many blocks of the kernel that posts there is room for one of the kernel that looks.
inline constexpr uint32_t kMailBoxes = 6;

}  // namespace voxelpipe::cuda
