#include "batch/manifest.h"

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <fstream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/checksum/sha256.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxLineBytes = size_t{1} << 20;

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

bool IsBlank(std::string_view text) {
  return text.find_first_not_of(" \t\r") == std::string_view::npos;
}

// DATA_LOSS unless it is for good: another attempt may find the file.
absl::Status CannotBeRead(const std::string& path, int error) {
  const std::string text = absl::StrCat(path, ": cannot be read: ", std::strerror(error));
  const bool for_good = error == EACCES || error == ENOTDIR || error == ELOOP || error == ENAMETOOLONG;
  return for_good ? absl::InvalidArgumentError(text) : absl::DataLossError(text);
}

// The lines of a file that are not blank.
class LineReader {
 public:
  static absl::StatusOr<LineReader> Open(const std::string& path) {
    std::error_code error;
    const bool exists = fs::exists(path, error);
    if (error) return CannotBeRead(path, error.value());
    if (!exists) return absl::NotFoundError(absl::StrCat(path, ": no such file"));
    if (fs::is_directory(path, error)) return Wrong(path, ": is a directory");
    LineReader reader(path);
    errno = 0;
    reader.file_.open(path, std::ios::binary);
    if (!reader.file_) return CannotBeRead(path, errno);
    return reader;
  }

  // False at the end of the file.
  absl::StatusOr<bool> Next() {
    while (std::getline(file_, text_)) {
      if (++line_ == 1 && text_.starts_with("\xEF\xBB\xBF")) text_.erase(0, 3);  // a byte order mark of some editors
      if (!IsBlank(text_)) return true;
    }
    if (file_.bad()) return absl::DataLossError(absl::StrCat(path_, ": cannot be read completely"));
    return false;
  }
  size_t line() const { return line_; }  // from 1
  const std::string& text() const { return text_; }

 private:
  explicit LineReader(std::string path) : path_(std::move(path)) {}

  std::string path_;
  std::ifstream file_;
  size_t line_ = 0;
  std::string text_;
};

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using TemporaryFile = std::unique_ptr<std::FILE, CloseFile>;

// A copy of what can be read once only, such as a pipe; nothing if the file can be read again.
absl::StatusOr<TemporaryFile> CopyOfPipe(const std::string& path) {
  std::error_code error;
  if (!fs::exists(path, error) || fs::is_directory(path, error) || fs::is_regular_file(path, error)) {
    return TemporaryFile();  // LineReader reports the error
  }
  TemporaryFile copy(std::tmpfile());
  std::ifstream pipe(path, std::ios::binary);
  if (copy == nullptr || !pipe) return Wrong(path, ": cannot be read: ", std::strerror(errno));
  for (std::array<char, 65536> bytes{}; pipe.read(bytes.data(), bytes.size()) || pipe.gcount() > 0;) {
    const auto count = size_t(pipe.gcount());
    if (std::fwrite(bytes.data(), 1, count, copy.get()) != count) {
      return Wrong(path, ": cannot be copied: ", std::strerror(errno));
    }
  }
  if (std::fflush(copy.get()) != 0) return Wrong(path, ": cannot be copied: ", std::strerror(errno));
  return copy;
}

}  // namespace

absl::StatusOr<ManifestFacts> ScanManifest(const std::string& path, const OnItemLine& on_item) {
  absl::StatusOr<LineReader> lines = LineReader::Open(path);
  if (!lines.ok()) return lines.status();
  ManifestFacts facts;
  Sha256 hash;
  for (;;) {
    const absl::StatusOr<bool> more = lines->Next();
    if (!more.ok()) return more.status();
    if (!*more) break;
    const std::string text = absl::StrCat(lines->line(), " ", lines->text(), "\n");
    hash.Update({reinterpret_cast<const uint8_t*>(text.data()), text.size()});
    if (on_item) on_item(lines->line(), facts.items, lines->text());
    ++facts.items;
  }
  facts.sha256 = hash.HexDigest();
  return facts;
}

class ManifestReader::Impl {
 public:
  Impl(std::string path, TemporaryFile copy, LineReader lines, const ManifestDefaults& defaults, const Shard& shard)
      : path_(std::move(path)),
        copy_(std::move(copy)),
        lines_(std::move(lines)),
        shard_(shard),
        parser_(fs::path(path_).parent_path().string(), defaults) {}

  // The path that can be read more than once.
  static std::string Readable(const std::string& path, const TemporaryFile& copy) {
    return copy == nullptr ? path : absl::StrCat("/proc/self/fd/", fileno(copy.get()));
  }

  absl::Status ReadAhead() {
    for (size_t lines = 0, bytes = 0; lines < kCheckedLines && bytes < kCheckedBytes; ++lines) {
      absl::StatusOr<std::optional<BatchItem>> item = ReadOne();
      if (!item.ok()) return item.status();
      if (at_end_) return absl::OkStatus();
      bytes += lines_.text().size();
      if (*item) ahead_.push_back(**std::move(item));
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::optional<BatchItem>> Next() {
    if (!ahead_.empty()) {
      std::optional<BatchItem> item = std::move(ahead_.front());
      ahead_.pop_front();
      return item;
    }
    while (!at_end_ && failed_.ok()) {
      absl::StatusOr<std::optional<BatchItem>> item = ReadOne();
      if (!item.ok()) failed_ = item.status();
      if (item.ok() && *item) return item;
    }
    if (!failed_.ok()) return failed_;
    return std::nullopt;
  }

  absl::StatusOr<ManifestFacts> Scan() const { return ScanManifest(Readable(path_, copy_)); }

 private:
  // Empty at the end, and for an item of another shard.
  absl::StatusOr<std::optional<BatchItem>> ReadOne() {
    const absl::StatusOr<bool> more = lines_.Next();
    if (!more.ok()) return more.status();
    at_end_ = !*more;
    if (at_end_) return std::nullopt;
    const std::string& text = lines_.text();
    absl::StatusOr<BatchItem> item = text.size() > kMaxLineBytes ? Wrong("longer than ", kMaxLineBytes, " bytes")
                                                                 : parser_.Parse(lines_.line(), text);
    if (!item.ok()) return Wrong(path_, ":", lines_.line(), ": ", std::string(item.status().message()));
    item->number = number_++;
    if (!shard_.Holds(item->number)) return std::nullopt;
    return *std::move(item);
  }

  const std::string path_;
  const TemporaryFile copy_;
  LineReader lines_;
  const Shard shard_;
  ItemParser parser_;
  size_t number_ = 0;
  std::deque<BatchItem> ahead_;
  bool at_end_ = false;
  absl::Status failed_ = absl::OkStatus();
};

absl::StatusOr<ManifestReader> ManifestReader::Open(const std::string& path, const ManifestDefaults& defaults,
                                                    const Shard& shard) {
  absl::StatusOr<TemporaryFile> copy = CopyOfPipe(path);
  if (!copy.ok()) return copy.status();
  absl::StatusOr<LineReader> lines = LineReader::Open(Impl::Readable(path, *copy));
  if (!lines.ok()) return lines.status();
  auto impl = std::make_unique<Impl>(path, *std::move(copy), *std::move(lines), defaults, shard);
  if (absl::Status s = impl->ReadAhead(); !s.ok()) return s;
  return ManifestReader(std::move(impl));
}

ManifestReader::ManifestReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ManifestReader::ManifestReader(ManifestReader&&) noexcept = default;
ManifestReader::~ManifestReader() = default;

absl::StatusOr<std::optional<BatchItem>> ManifestReader::Next() {
  return impl_->Next();
}

absl::StatusOr<ManifestFacts> ManifestReader::Scan() const {
  return impl_->Scan();
}

}  // namespace voxelpipe::cli
