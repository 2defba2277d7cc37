// The header of NumPy's array files.
#pragma once

#include "absl/status/statusor.h"
#include "encode/read/stored_array.h"

namespace voxelpipe {

// In: a file, and the part of it that holds a .npy; `where` names it in messages. Out: the array, whose elements fill
// the part to its end. Versions 1.0 to 3.0, C order, the types of StoredType but kBit, at most 8 axes, headers of at
// most 64 KiB. Errors: INVALID_ARGUMENT naming what is wrong, those of InputFile::ReadAt.
absl::StatusOr<StoredArray> ReadNpyHeader(std::shared_ptr<const InputFile> file, uint64_t begin, uint64_t end,
                                          const std::string& where);

}  // namespace voxelpipe
