#include "encode/zip_writer.h"

#include "absl/strings/str_cat.h"
#include "base/checksum/crc32.h"

namespace voxelpipe {
namespace {

constexpr uint16_t kVersion = 45;    // 4.5: ZIP64
constexpr uint16_t kFlags = 1 << 3;  // checksum and sizes follow the data
constexpr uint32_t kDate = 0x21;     // 1 January 1980, so that archives are reproducible
constexpr uint16_t kZip64Extra = 1;
constexpr uint32_t kInExtra = 0xffffffff;

class Record {
 public:
  Record& U16(uint64_t v) { return Put(v, 2); }
  Record& U32(uint64_t v) { return Put(v, 4); }
  Record& U64(uint64_t v) { return Put(v, 8); }
  Record& Text(const std::string& text) {
    bytes_ += text;
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  Record& Put(uint64_t v, int count) {
    for (int i = 0; i < count; ++i) bytes_ += char(v >> (8 * i) & 0xff);
    return *this;
  }
  std::string bytes_;
};

}  // namespace

absl::Status ZipWriter::Put(const std::string& record) {
  at_ += record.size();
  return file_.Write({reinterpret_cast<const uint8_t*>(record.data()), record.size()}, job_);
}

absl::Status ZipWriter::BeginEntry(const std::string& name, uint64_t bytes) {
  entries_.push_back({name, at_, bytes, 0});
  written_ = 0;
  Record header;
  header.U32(0x04034b50).U16(kVersion).U16(kFlags).U16(0).U32(kDate << 16).U32(0).U32(kInExtra).U32(kInExtra);
  header.U16(name.size()).U16(20).Text(name);
  header.U16(kZip64Extra).U16(16).U64(bytes).U64(bytes);
  return Put(header.bytes());
}

absl::Status ZipWriter::Write(std::span<const uint8_t> bytes) {
  Entry& entry = entries_.back();
  entry.crc = Crc32(entry.crc, bytes);
  written_ += bytes.size();
  at_ += bytes.size();
  return file_.Write(bytes, job_);
}

absl::Status ZipWriter::EndEntry() {
  const Entry& entry = entries_.back();
  if (written_ != entry.bytes) {
    return absl::InternalError(absl::StrCat("'", entry.name, "': ", written_, " bytes, ", entry.bytes, " announced"));
  }
  return Put(Record().U32(0x08074b50).U32(entry.crc).U64(entry.bytes).U64(entry.bytes).bytes());
}

absl::Status ZipWriter::Finish() {
  const uint64_t directory = at_;
  for (const Entry& entry : entries_) {
    Record header;
    header.U32(0x02014b50).U16(kVersion).U16(kVersion).U16(kFlags).U16(0).U32(kDate << 16).U32(entry.crc);
    header.U32(kInExtra).U32(kInExtra).U16(entry.name.size()).U16(28).U16(0).U16(0).U16(0).U32(0).U32(kInExtra);
    header.Text(entry.name).U16(kZip64Extra).U16(24).U64(entry.bytes).U64(entry.bytes).U64(entry.offset);
    if (absl::Status s = Put(header.bytes()); !s.ok()) return s;
  }
  const uint64_t directory_bytes = at_ - directory, end64 = at_, count = entries_.size();
  Record end;
  end.U32(0x06064b50).U64(44).U16(kVersion).U16(kVersion).U32(0).U32(0).U64(count).U64(count);
  end.U64(directory_bytes).U64(directory);
  end.U32(0x07064b50).U32(0).U64(end64).U32(1);
  end.U32(0x06054b50).U16(0).U16(0).U16(0xffff).U16(0xffff).U32(kInExtra).U32(kInExtra).U16(0);
  return Put(end.bytes());
}

}  // namespace voxelpipe
