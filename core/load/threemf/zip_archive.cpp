#include "load/threemf/zip_archive.h"

#include <zlib.h>

#include <algorithm>
#include <vector>

#include "load/base/text_reader.h"
#include "load/decode/foreign_decoders.h"

namespace voxelpipe::threemf {
namespace {

constexpr uint64_t kEndBytes = 22, kMaxComment = 0xffff, kHeaderBytes = 46, kLocalBytes = 30;
constexpr uint64_t kEnd64Bytes = 56, kLocatorBytes = 20;
constexpr uint64_t kMaxDirectoryBytes = 4 << 20, kPieceBytes = 64 << 10;
constexpr uint64_t kMaxRatio = 256, kMinUnpackedBytes = 1 << 20;
constexpr uint64_t kInExtra = 0xffffffff;
constexpr uint16_t kStored = 0, kDeflated = 8, kEncrypted = 1;

uint64_t Number(std::span<const uint8_t> bytes, uint64_t at, int count) {
  uint64_t value = 0;
  for (int i = 0; i < count; ++i) value |= uint64_t{bytes[at + uint64_t(i)]} << (8 * i);
  return value;
}

char LowerOf(char c) {
  return c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c;
}

// Below, at or above 0 as memcmp, whatever the case of letters.
int CompareParts(std::string_view a, std::string_view b) {
  for (size_t i = 0; i < a.size() && i < b.size(); ++i) {
    const auto left = static_cast<unsigned char>(LowerOf(a[i])), right = static_cast<unsigned char>(LowerOf(b[i]));
    if (left != right) return left < right ? -1 : 1;
  }
  return a.size() < b.size() ? -1 : a.size() > b.size() ? 1 : 0;
}

// Takes the 64-bit values of those fields that say so, in the order of the fields.
bool ReadZip64(std::span<const uint8_t> extra, std::initializer_list<uint64_t*> fields) {
  while (extra.size() >= 4) {
    const uint64_t id = Number(extra, 0, 2), bytes = Number(extra, 2, 2);
    if (bytes > extra.size() - 4) return false;
    if (id == 1) {
      uint64_t at = 4;
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

absl::StatusOr<ZipArchive> ZipArchive::Open(std::span<const uint8_t> bytes, LoadBudget& budget) {
  if (absl::Status s = CheckForeignDecoders(); !s.ok()) return s;
  if (bytes.size() < kEndBytes) return budget.Invalid("too short for a ZIP archive");
  const uint64_t last = bytes.size() - kEndBytes;
  const uint64_t first = last - std::min(last, kMaxComment);
  uint64_t end = last;
  while (Number(bytes, end, 4) != 0x06054b50 || end + kEndBytes + Number(bytes, end + 20, 2) > bytes.size()) {
    if (end-- == first) return budget.Invalid("no end of a ZIP directory; the file may be cut off");
  }
  uint64_t size = Number(bytes, end + 12, 4), begin = Number(bytes, end + 16, 4);
  if ((size == kInExtra || begin == kInExtra) && end >= kLocatorBytes + kEnd64Bytes) {
    const uint64_t end64 = Number(bytes, end - kLocatorBytes + 8, 8);
    if (Number(bytes, end - kLocatorBytes, 4) != 0x07064b50 || end64 > end - kLocatorBytes - kEnd64Bytes ||
        Number(bytes, end64, 4) != 0x06064b50) {
      return budget.Invalid("byte ", end - kLocatorBytes, ": the ZIP64 locator is invalid");
    }
    size = Number(bytes, end64 + 40, 8);
    begin = Number(bytes, end64 + 48, 8);
    end = end64;
  }
  if (begin > end || size > end - begin)
    return budget.Invalid("byte ", end, ": the ZIP directory lies outside the file");
  if (size > kMaxDirectoryBytes) {
    return budget.Invalid("a ZIP directory of ", size, " bytes, at most ", kMaxDirectoryBytes);
  }
  // Names and their places in the map.
  if (absl::Status full = budget.Take(size, 4, "the directory"); !full.ok()) return full;
  ZipArchive archive(bytes, budget);
  if (absl::Status bad = archive.ReadDirectory(begin, begin + size); !bad.ok()) return bad;
  return archive;
}

absl::Status ZipArchive::ReadDirectory(uint64_t begin, uint64_t end) {
  for (uint64_t at = begin; at < end;) {
    if (end - at < kHeaderBytes || Number(bytes_, at, 4) != 0x02014b50) {
      return budget_->Invalid("byte ", at, ": no entry of a ZIP directory");
    }
    const uint64_t name_bytes = Number(bytes_, at + 28, 2), extra_bytes = Number(bytes_, at + 30, 2);
    const uint64_t bytes = kHeaderBytes + name_bytes + extra_bytes + Number(bytes_, at + 32, 2);
    if (bytes > end - at) return budget_->Invalid("byte ", at, ": an entry ends outside the ZIP directory");
    const std::string name(reinterpret_cast<const char*>(bytes_.data()) + at + kHeaderBytes, name_bytes);
    Entry entry;
    entry.flags = uint16_t(Number(bytes_, at + 8, 2));
    entry.method = uint16_t(Number(bytes_, at + 10, 2));
    entry.crc = uint32_t(Number(bytes_, at + 16, 4));
    entry.packed = Number(bytes_, at + 20, 4);
    entry.size = Number(bytes_, at + 24, 4);
    entry.offset = Number(bytes_, at + 42, 4);
    const auto extra = bytes_.subspan(at + kHeaderBytes + name_bytes, extra_bytes);
    if (!ReadZip64(extra, {&entry.size, &entry.packed, &entry.offset})) {
      return budget_->Invalid("the entry ", Quote(name), " has no ZIP64 sizes");
    }
    if (!entries_.emplace(name, entry).second) {
      return budget_->Invalid("byte ", at, ": a second entry ", Quote(name));
    }
    at += bytes;
  }
  return absl::OkStatus();
}

bool ZipArchive::PartOrder::operator()(const std::string& a, const std::string& b) const {
  const int order = CompareParts(a, b);
  return order != 0 ? order < 0 : a < b;
}

std::string ZipArchive::Find(std::string_view part) const {
  if (!part.empty() && part[0] == '/') part.remove_prefix(1);
  std::string name(part);
  if (entries_.count(name) != 0) return name;
  // Capital letters come first.
  for (char& c : name) c = c >= 'a' && c <= 'z' ? char(c - 'a' + 'A') : c;
  const auto first = entries_.lower_bound(name);
  return first != entries_.end() && CompareParts(first->first, name) == 0 ? first->first : std::string();
}

std::string ZipArchive::FindByEnd(std::string_view end) const {
  const std::string* first = nullptr;
  for (const auto& [name, entry] : entries_) {
    if (name.size() < end.size()) continue;
    const std::string_view last = std::string_view(name).substr(name.size() - end.size());
    if (CompareParts(last, end) == 0 && (first == nullptr || name < *first)) first = &name;
  }
  return first == nullptr ? std::string() : *first;
}

uint64_t ZipArchive::SizeOf(const std::string& name) const {
  const auto found = entries_.find(name);
  return found == entries_.end() ? 0 : found->second.size;
}

absl::Status ZipArchive::Unpack(const std::string& name, const Consumer& consume) {
  const auto found = entries_.find(name);
  if (found == entries_.end()) return budget_->Invalid("no entry ", Quote(name));
  const Entry& entry = found->second;
  const auto bad = [&](const auto&... what) { return budget_->Invalid("the entry ", Quote(name), what...); };
  if ((entry.flags & kEncrypted) != 0) return bad(" is encrypted");
  if (entry.method != kStored && entry.method != kDeflated) {
    return bad(" is compressed by the method ", entry.method, "; stored and deflated entries are read");
  }
  if (entry.offset > bytes_.size() || bytes_.size() - entry.offset < kLocalBytes ||
      Number(bytes_, entry.offset, 4) != 0x04034b50) {
    return bad(" has no header at byte ", entry.offset);
  }
  const uint64_t begin =
      entry.offset + kLocalBytes + Number(bytes_, entry.offset + 26, 2) + Number(bytes_, entry.offset + 28, 2);
  if (begin > bytes_.size() || entry.packed > bytes_.size() - begin) return bad(" ends outside the file");
  if (entry.method == kStored && entry.packed != entry.size) return bad(" has two different sizes");
  const uint64_t most = std::max(kMinUnpackedBytes, bytes_.size() * kMaxRatio);
  if (entry.size > most - unpacked_) {
    return absl::ResourceExhaustedError(absl::StrCat("3MF: the entry ", Quote(name), " has ", entry.size,
                                                     " bytes unpacked; all entries of a file of ", bytes_.size(),
                                                     " bytes may have ", most));
  }
  unpacked_ += entry.size;
  return Inflate(bytes_.subspan(begin, entry.packed), entry, name, consume);
}

absl::Status ZipArchive::Inflate(std::span<const uint8_t> packed, const Entry& entry, const std::string& name,
                                 const Consumer& consume) {
  const auto bad = [&](const char* what) { return budget_->Invalid("the entry ", Quote(name), what); };
  uint32_t crc = uint32_t(crc32(0, nullptr, 0));
  uint64_t size = 0;
  const auto pass = [&](std::span<const uint8_t> piece) {
    if (absl::Status over = budget_->job().Check(); !over.ok()) return over;
    crc = uint32_t(crc32(crc, piece.data(), uInt(piece.size())));
    size += piece.size();
    return size > entry.size ? bad(" is longer than the directory says") : consume(piece);
  };
  const auto end = [&] {
    if (size != entry.size) return bad(" is shorter than the directory says");
    return crc == entry.crc ? absl::OkStatus() : bad(" does not have its CRC-32");
  };
  if (entry.method == kStored) {
    for (uint64_t at = 0; at < packed.size(); at += kPieceBytes) {
      absl::Status status = pass(packed.subspan(at, std::min<uint64_t>(kPieceBytes, packed.size() - at)));
      if (!status.ok()) return status;
    }
    return end();
  }
  z_stream stream{};
  if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) return absl::ResourceExhaustedError("3MF: no memory to unpack");
  std::vector<uint8_t> piece(kPieceBytes);
  absl::Status status;
  int result = Z_OK;
  for (uint64_t at = 0; status.ok() && result == Z_OK;) {
    if (stream.avail_in == 0) {
      const uint64_t bytes = std::min<uint64_t>(kPieceBytes, packed.size() - at);
      stream.next_in = const_cast<Bytef*>(packed.data() + at);
      stream.avail_in = uInt(bytes);
      at += bytes;
    }
    stream.next_out = piece.data();
    stream.avail_out = uInt(piece.size());
    result = inflate(&stream, Z_NO_FLUSH);
    const uint64_t made = piece.size() - stream.avail_out;
    if (made > 0) status = pass({piece.data(), made});
    if (result == Z_OK && made == 0 && stream.avail_in == 0 && at == packed.size()) result = Z_BUF_ERROR;
  }
  inflateEnd(&stream);
  if (!status.ok()) return status;
  return result == Z_STREAM_END ? end() : bad(" is no valid deflate stream, or is cut off");
}

}  // namespace voxelpipe::threemf
