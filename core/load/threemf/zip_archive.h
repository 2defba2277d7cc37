// The entries of a ZIP archive in memory, unpacked in pieces.
// Source: PKWARE, "APPNOTE.TXT - .ZIP File Format Specification", version 6.3.10 (2022).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "load/base/load_budget.h"

namespace voxelpipe::threemf {

class ZipArchive {
 public:
  // In: the whole archive, which must outlive this, and the budget that unpacking is charged to. Out: its directory, of
  // at most 4 MiB. Errors: INVALID_ARGUMENT naming the byte or entry.
  static absl::StatusOr<ZipArchive> Open(std::span<const uint8_t> bytes, LoadBudget& budget);

  // The name, as stored, of an entry by a part name: with or without a leading "/", the case of letters does not
  // matter. Empty if there is none.
  std::string Find(std::string_view part) const;
  // The first entry, by name, whose name ends so; empty if there is none.
  std::string FindByEnd(std::string_view end) const;

  // Unpacks an entry by its stored name, in pieces of at most 64 KiB. All entries together may take 256 times the
  // archive's size (and 1 MiB at least): a file costs in proportion to its size. Errors: INVALID_ARGUMENT naming the
  // entry (unknown method, encrypted, broken, wrong size or CRC-32), RESOURCE_EXHAUSTED naming the limit; the
  // consumer's; the job's.
  using Consumer = std::function<absl::Status(std::span<const uint8_t> piece)>;
  absl::Status Unpack(const std::string& name, const Consumer& consume);
  // Bytes of an entry when unpacked, as the directory says.
  uint64_t SizeOf(const std::string& name) const;

 private:
  struct Entry {
    uint64_t offset = 0, packed = 0, size = 0;  // of the local header; bytes
    uint32_t crc = 0;
    uint16_t method = 0, flags = 0;
  };

  ZipArchive(std::span<const uint8_t> bytes, LoadBudget& budget) : bytes_(bytes), budget_(&budget) {}
  absl::Status ReadDirectory(uint64_t begin, uint64_t end);
  absl::Status Inflate(std::span<const uint8_t> packed, const Entry& entry, const std::string& name,
                       const Consumer& consume);

  std::span<const uint8_t> bytes_;
  LoadBudget* budget_;
  // By the name without the case of its letters, then by the name: those of one part name stand together.
  struct PartOrder {
    bool operator()(const std::string& a, const std::string& b) const;
  };
  std::map<std::string, Entry, PartOrder> entries_;
  uint64_t unpacked_ = 0;  // by all calls
};

}  // namespace voxelpipe::threemf
