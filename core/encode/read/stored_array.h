// An array in a file, and reading it from front to back.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "encode/read/input_file.h"

namespace voxelpipe {

// Little endian; kBit packed, as in job/result.h.
enum class StoredType : uint8_t { kBit, kU8, kU16, kU32, kI32, kI64, kF16, kF32, kF64 };

// NumPy's type string ("|u1", "<f4"), or "bit".
std::string_view Name(StoredType type);
std::optional<StoredType> ParseStoredType(std::string_view name);

struct StoredArray {
  std::string where;  // file and array, for messages
  std::shared_ptr<const InputFile> file;
  uint64_t offset = 0;  // of the first element, bytes
  StoredType type = StoredType::kU8;
  std::vector<uint64_t> shape;  // C order

  uint64_t count() const;  // elements
};

// In: a shape. Out: its number of elements and the bytes that these take, or nothing if either exceeds 2^62.
std::optional<uint64_t> ElementsOf(std::span<const uint64_t> shape);
std::optional<uint64_t> StoredBytes(StoredType type, uint64_t count);

// Reads elements as numbers, with a buffer of 64 KiB. All types but kI64 are exact in double; integers beyond 2^53 are
// read with NextInteger.
class ArrayReader {
 public:
  // Begins at element `first`.
  explicit ArrayReader(StoredArray array, uint64_t first = 0);

  // The next element; the caller reads at most count() - first of them. Errors: those of InputFile::ReadAt.
  absl::Status Next(double& value);
  // The same of kU8 to kI64.
  absl::Status NextInteger(int64_t& value);
  void Skip(uint64_t elements) { next_ += elements; }

 private:
  absl::Status Fill();
  // Makes the next element the current one; returns its first byte.
  absl::Status Advance(const uint8_t*& bytes);

  StoredArray array_;
  uint64_t count_, next_;         // elements of the array; the next one
  uint64_t begin_ = 0, end_ = 0;  // elements in the buffer; begin_ is a multiple of 8
  std::vector<uint8_t> buffer_;
};

}  // namespace voxelpipe
