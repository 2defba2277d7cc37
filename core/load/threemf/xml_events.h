// XML as a sequence of elements, by expat, bounded: no document type, no entities but the predefined ones, a depth and
// a memory of its own.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "load/base/load_budget.h"

namespace voxelpipe::threemf {

// The attributes of an element by their names without prefixes. Valid during the call.
class Attributes {
 public:
  explicit Attributes(const char** list) : list_(list) {}
  // Null if there is none of this name.
  const char* Find(std::string_view name) const;

 private:
  const char** list_;  // name, value, name, value, ..., null; names with their namespace and '|'
};

class XmlEvents {
 public:
  // Called with the name of an element without its namespace, which is one of 3MF (or of OPC, for relationships).
  // Elements of other namespaces, and all within them, are left out. An error ends the parsing.
  using Begin = std::function<absl::Status(std::string_view name, const Attributes& attributes)>;
  using End = std::function<absl::Status(std::string_view name)>;

  // `part`: the name of the document for errors.
  XmlEvents(std::string part, LoadBudget& budget, Begin begin, End end);
  ~XmlEvents();
  XmlEvents(const XmlEvents&) = delete;
  XmlEvents& operator=(const XmlEvents&) = delete;

  // Parses the next piece. Errors: INVALID_ARGUMENT naming part and line; those of the functions.
  absl::Status Parse(std::span<const uint8_t> piece);
  // Ends the document.
  absl::Status Finish();
  // That of the current element.
  uint64_t line() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe::threemf
