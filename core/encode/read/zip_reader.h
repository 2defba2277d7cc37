// ZIP archives of stored entries, as ZipWriter and numpy.savez write them.
#pragma once

#include "absl/status/statusor.h"
#include "encode/read/input_file.h"

#include <vector>

namespace voxelpipe {

struct ZipEntry {
  std::string name;
  uint64_t begin = 0, end = 0;  // bytes of the file
};

// In: a file. Out: its entries in the order of the directory, names distinct. ZIP64 or not; a directory of at most
// 1 MiB.
// Checksums are not verified. Errors: INVALID_ARGUMENT with path and entry, for one that is compressed or encrypted
// among others; those of InputFile::ReadAt.
absl::StatusOr<std::vector<ZipEntry>> ReadZipDirectory(const InputFile& file);

}  // namespace voxelpipe
