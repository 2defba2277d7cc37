// Serialization of plain values, for two processes of the same build on one machine. The input may come from a process
// compromised by a hostile file: every count is checked, and nothing is allocated beyond what the bytes can hold.
//
// One function template per type lists its fields, for both directions: `fields(archive, value)` with an ArchiveWriter
// and a const value, or an ArchiveReader and a value to fill.
#pragma once

#include <concepts>
#include <cstdint>
#include <cstring>
#include <functional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "base/huge_pages.h"

namespace voxelpipe {

// All bit patterns are valid values of such a type, and it has no padding.
template <typename T>
concept PlainValue = std::is_trivially_copyable_v<T> && !std::is_same_v<T, bool> && !std::is_enum_v<T>;

// Arrays of at least this many bytes are not copied into the text of an archive.
inline constexpr uint64_t kMinBulkBytes = 4096;
// Alignment of these arrays.
inline constexpr uint64_t kBulkAlignment = 64;

// Collects the text (all small values, one after the other) and references to large arrays, which are not copied. The
// bulk is these arrays, each from the next multiple of kBulkAlignment on.
class ArchiveWriter {
 public:
  static constexpr bool kReads = false;

  template <PlainValue T>
  void Value(const T& value) {
    Append(&value, sizeof value);
  }
  void Flag(const bool& value) { Value(uint8_t{value}); }
  template <typename E>
  requires std::is_enum_v<E>
  void Enum(const E& value, E /*last*/) { Value(static_cast<uint8_t>(value)); }
  void Text(const std::string& text) {
    Value(uint64_t{text.size()});
    Append(text.data(), text.size());
  }
  // Must not change until the bulk has been copied.
  template <PlainValue T, typename A>
  void Array(const std::vector<T, A>& values) {
    Value(uint64_t{values.size()});
    AddBulkOrAppend(values.data(), values.size() * sizeof(T));
  }
  // Read by ArchiveReader::View or as an Array of bytes. The same rule as for Array.
  void Bytes(std::span<const uint8_t> bytes) {
    Value(uint64_t{bytes.size()});
    AddBulkOrAppend(bytes.data(), bytes.size());
  }
  template <typename List, typename Fields>
  void Each(const List& list, uint64_t /*least_bytes*/, Fields fields) {
    Value(uint64_t{list.size()});
    for (const auto& element : list) fields(*this, element);
  }
  void Refuse(const char* /*why*/) {}

  const std::vector<uint8_t>& text() const { return text_; }
  uint64_t bulk_bytes() const { return bulk_bytes_; }
  // Copies the bulk to `to`, which has bulk_bytes(), on several threads.
  void CopyBulk(uint8_t* to) const;

 private:
  struct Bulk {
    const uint8_t* data = nullptr;
    uint64_t bytes = 0, offset = 0;
  };
  void AddBulkOrAppend(const void* data, uint64_t bytes) {
    if (bytes < kMinBulkBytes) return Append(data, bytes);
    bulk_bytes_ = (bulk_bytes_ + kBulkAlignment - 1) / kBulkAlignment * kBulkAlignment;
    bulk_.push_back({static_cast<const uint8_t*>(data), bytes, bulk_bytes_});
    bulk_bytes_ += bytes;
  }
  void Append(const void* data, uint64_t bytes) {
    if (bytes == 0) return;
    // Not insert(): GCC 12 falsely warns of an overflow in its inlined code.
    const size_t end = text_.size();
    text_.resize(end + bytes);
    std::memcpy(text_.data() + end, data, bytes);
  }

  std::vector<uint8_t> text_;
  std::vector<Bulk> bulk_;
  uint64_t bulk_bytes_ = 0;
};

// Reads in the same order. After the first fault all values are zeros and all lists empty. Finish fills the arrays of
// the bulk. `text` must be private memory; `bulk` may change concurrently, so it is copied once and the copy is
// checked.
class ArchiveReader {
 public:
  static constexpr bool kReads = true;

  // Both must outlive this.
  ArchiveReader(std::span<const uint8_t> text, std::span<const uint8_t> bulk) : text_(text), bulk_(bulk) {}

  template <PlainValue T>
  void Value(T& value) {
    Take(&value, sizeof value);
  }
  void Flag(bool& value) {
    uint8_t byte = 0;
    Value(byte);
    if (byte > 1) Refuse("a flag");
    value = byte == 1;
  }
  template <typename E>
  requires std::is_enum_v<E>
  void Enum(E& value, E last) {
    uint8_t byte = 0;
    Value(byte);
    if (byte > static_cast<uint64_t>(last)) Refuse("an enumeration");
    value = ok() ? static_cast<E>(byte) : E{};
  }
  void Text(std::string& text) {
    const uint64_t size = Count(1);
    text.assign(reinterpret_cast<const char*>(text_.data()), size);
    text_ = text_.subspan(size);
  }
  // `values` must not move until Finish.
  template <PlainValue T, typename A>
  void Array(std::vector<T, A>& values) {
    uint64_t count = 0;
    Value(count);
    if (count < kMinBulkBytes / sizeof(T) + 1 && count * sizeof(T) < kMinBulkBytes) {
      const uint64_t bytes = count * sizeof(T);
      if (bytes > text_.size()) return Refuse("an array ends too late");
      values.resize(count);
      Take(values.data(), bytes);
      return;
    }
    const T* const first = reinterpret_cast<const T*>(TakeBulk(count, sizeof(T)));
    if (first != nullptr) copies_.push_back([&values, first, count] { CopyArray(first, count, values); });
  }
  // A view of the bytes in the text or the bulk: only if the writer is trusted not to change them.
  void View(std::span<const uint8_t>& bytes) {
    uint64_t count = 0;
    Value(count);
    if (count < kMinBulkBytes) {
      if (count > text_.size()) return Refuse("an array ends too late");
      bytes = text_.first(count);
      text_ = text_.subspan(count);
    } else if (const uint8_t* const first = TakeBulk(count, 1); first != nullptr) {
      bytes = {first, count};
    }
  }
  // Each element takes at least this many bytes of text. Afterwards the list must not change until Finish.
  template <typename List, typename Fields>
  void Each(List& list, uint64_t least_bytes, Fields fields) {
    list.resize(Count(least_bytes));
    for (auto& element : list) fields(*this, element);
  }
  // Only the first reason counts.
  void Refuse(const char* why) {
    if (fault_ == nullptr) fault_ = why;
    text_ = {};
  }
  bool ok() const { return fault_ == nullptr; }

  // Fills the arrays of the bulk, on several threads. INTERNAL if the bytes are not a valid archive. May throw
  // bad_alloc.
  absl::Status Finish();

 private:
  template <typename T, typename A>
  static void CopyArray(const T* first, uint64_t count, std::vector<T, A>& values) {
    values.clear();
    if constexpr (std::is_same_v<std::vector<T, A>, std::vector<T>>) ReserveHuge(values, count);
    values.assign(first, first + count);
  }

  // The address of the next elements in the bulk; null if it ends before.
  const uint8_t* TakeBulk(uint64_t count, uint64_t bytes_each) {
    const uint64_t begin = (bulk_used_ + kBulkAlignment - 1) / kBulkAlignment * kBulkAlignment;
    if (begin > bulk_.size() || count > (bulk_.size() - begin) / bytes_each) {
      Refuse("an array ends too late");
      return nullptr;
    }
    bulk_used_ = begin + count * bytes_each;
    return bulk_.data() + begin;
  }
  // For elements that take at least this many bytes of text each.
  uint64_t Count(uint64_t least_bytes) {
    uint64_t count = 0;
    Value(count);
    if (count > text_.size() / least_bytes) Refuse("a list is longer than its bytes");
    return ok() ? count : 0;
  }
  void Take(void* to, uint64_t bytes) {
    if (bytes == 0) return;
    if (bytes > text_.size()) {
      Refuse("the bytes end too early");
      std::memset(to, 0, bytes);
      return;
    }
    std::memcpy(to, text_.data(), bytes);
    text_ = text_.subspan(bytes);
  }

  std::span<const uint8_t> text_, bulk_;
  uint64_t bulk_used_ = 0;
  const char* fault_ = nullptr;
  std::vector<std::function<void()>> copies_;
};

}  // namespace voxelpipe
