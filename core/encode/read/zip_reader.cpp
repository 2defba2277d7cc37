// Source: as zip_writer.h.
#include "encode/read/zip_reader.h"

#include <algorithm>
#include <set>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "base/text.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kInExtra = 0xffffffff;
constexpr uint64_t kMaxDirectoryBytes = 1 << 20;

uint64_t Number(std::span<const uint8_t> bytes, size_t at, int count) {
  uint64_t value = 0;
  for (int i = 0; i < count; ++i) value |= uint64_t{bytes[at + size_t(i)]} << (8 * i);
  return value;
}

struct Directory {
  uint64_t offset = 0, bytes = 0, entries = 0;
};

absl::StatusOr<Directory> FindDirectory(const InputFile& file) {
  const auto bad = [&](std::string_view what) {
    return absl::InvalidArgumentError(absl::StrCat(file.path(), ": ", std::string(what)));
  };
  constexpr uint64_t kEndBytes = 22, kLocatorBytes = 20, kEnd64Bytes = 56, kMaxComment = 0xffff;
  if (file.bytes() < kEndBytes) return bad("too short for a .npz");
  std::vector<uint8_t> tail(std::min(file.bytes(), kEndBytes + kMaxComment));
  const uint64_t tail_at = file.bytes() - tail.size();
  if (absl::Status s = file.ReadAt(tail_at, tail); !s.ok()) return s;
  size_t at = tail.size() - kEndBytes;
  while (Number(tail, at, 4) != 0x06054b50 || at + kEndBytes + Number(tail, at + 20, 2) != tail.size()) {
    if (at-- == 0) return bad("not a .npz: no end of a ZIP directory; the file may be cut off");
  }
  Directory directory{Number(tail, at + 16, 4), Number(tail, at + 12, 4), Number(tail, at + 10, 2)};
  uint64_t limit = tail_at + at;  // the directory ends before
  if (directory.offset == kInExtra || directory.bytes == kInExtra || directory.entries == 0xffff) {
    uint8_t locator[kLocatorBytes], end64[kEnd64Bytes];
    if (limit < kLocatorBytes + kEnd64Bytes) return bad("no room for its ZIP64 directory");
    if (absl::Status s = file.ReadAt(limit - kLocatorBytes, locator); !s.ok()) return s;
    const uint64_t end64_at = Number(locator, 8, 8);
    if (Number(locator, 0, 4) != 0x07064b50 || end64_at > limit - kLocatorBytes - kEnd64Bytes) {
      return bad(absl::StrCat("byte ", limit - kLocatorBytes, ": the ZIP64 locator is invalid"));
    }
    if (absl::Status s = file.ReadAt(end64_at, end64); !s.ok()) return s;
    if (Number(end64, 0, 4) != 0x06064b50) return bad(absl::StrCat("byte ", end64_at, ": no end of a ZIP64 directory"));
    directory = {Number(end64, 48, 8), Number(end64, 40, 8), Number(end64, 32, 8)};
    limit = end64_at;
  }
  if (directory.bytes > kMaxDirectoryBytes) {
    return bad(absl::StrCat("a directory of ", directory.bytes, " bytes, at most ", kMaxDirectoryBytes));
  }
  if (directory.offset > limit || directory.bytes > limit - directory.offset) {
    return bad("its directory lies outside the file");
  }
  return directory;
}

// Takes the 64-bit values of those fields that say so, in the order of the fields.
bool ReadZip64(std::span<const uint8_t> extra, std::initializer_list<uint64_t*> fields) {
  while (extra.size() >= 4) {
    const uint64_t id = Number(extra, 0, 2), bytes = Number(extra, 2, 2);
    if (bytes > extra.size() - 4) return false;
    if (id == 1) {
      size_t at = 4;
      for (uint64_t* field : fields) {
        if (*field != kInExtra) continue;
        if (at + 8 > 4 + bytes) return false;
        *field = Number(extra, at, 8);
        at += 8;
      }
      return true;
    }
    extra = extra.subspan(4 + bytes);
  }
  return std::none_of(fields.begin(), fields.end(), [](const uint64_t* field) { return *field == kInExtra; });
}

}  // namespace

absl::StatusOr<std::vector<ZipEntry>> ReadZipDirectory(const InputFile& file) {
  const absl::StatusOr<Directory> directory = FindDirectory(file);
  if (!directory.ok()) return directory.status();
  std::vector<uint8_t> all(directory->bytes);
  if (absl::Status s = file.ReadAt(directory->offset, all); !s.ok()) return s;
  std::vector<ZipEntry> entries;
  std::set<std::string> names;
  std::span<const uint8_t> rest = all;
  constexpr size_t kHeaderBytes = 46, kLocalBytes = 30;
  while (!rest.empty()) {
    const auto bad = [&](std::string_view what) {
      return absl::InvalidArgumentError(
          absl::StrCat(file.path(), ": entry ", entries.size(), " of the archive ", std::string(what)));
    };
    if (rest.size() < kHeaderBytes || Number(rest, 0, 4) != 0x02014b50) return bad("has no header in the directory");
    const size_t name_bytes = Number(rest, 28, 2), extra_bytes = Number(rest, 30, 2);
    const size_t bytes = kHeaderBytes + name_bytes + extra_bytes + Number(rest, 32, 2);
    if (bytes > rest.size()) return bad("ends outside the directory");
    ZipEntry entry;
    entry.name.assign(reinterpret_cast<const char*>(rest.data()) + kHeaderBytes, name_bytes);
    const std::string shown = absl::StrCat("('", CleanText(entry.name, 60), "') ");
    if ((Number(rest, 8, 2) & 1) != 0) return bad(shown + "is encrypted");
    if (Number(rest, 10, 2) != 0) return bad(shown + "is compressed; VoxelPipe and numpy.savez store them");
    uint64_t size = Number(rest, 24, 4), packed = Number(rest, 20, 4), offset = Number(rest, 42, 4);
    if (!ReadZip64(rest.subspan(kHeaderBytes + name_bytes, extra_bytes), {&size, &packed, &offset})) {
      return bad(shown + "has no ZIP64 sizes");
    }
    if (size != packed) return bad(shown + "has two different sizes");
    const uint64_t limit = directory->offset;
    if (offset > limit || limit - offset < kLocalBytes) return bad(shown + "begins outside the file");
    uint8_t local[kLocalBytes];
    if (absl::Status s = file.ReadAt(offset, local); !s.ok()) return s;
    if (Number(local, 0, 4) != 0x04034b50) return bad(absl::StrCat(shown, "has no header at byte ", offset));
    entry.begin = offset + kLocalBytes + Number(local, 26, 2) + Number(local, 28, 2);
    if (entry.begin > limit || size > limit - entry.begin) return bad(shown + "ends outside the file");
    entry.end = entry.begin + size;
    if (!names.insert(entry.name).second) return bad(shown + "has the name of another");
    entries.push_back(std::move(entry));
    rest = rest.subspan(bytes);
  }
  if (entries.size() != directory->entries) {
    return absl::InvalidArgumentError(absl::StrCat(file.path(), ": its directory has ", entries.size(),
                                                   " entries, and announces ", directory->entries));
  }
  return entries;
}

}  // namespace voxelpipe
