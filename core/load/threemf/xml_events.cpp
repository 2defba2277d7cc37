#include "load/threemf/xml_events.h"

#include <expat.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <new>
#include <utility>

#include "load/base/text_reader.h"

namespace voxelpipe::threemf {
namespace {

constexpr int kMaxDepth = 64;
// Of one parser: names and attributes of the open elements, and a token that is not complete.
constexpr size_t kMaxParserBytes = 16 << 20;
constexpr char kSeparator = '|';
constexpr std::string_view kNamespaces[] = {"http://schemas.microsoft.com/3dmanufacturing/",
                                            "http://schemas.openxmlformats.org/package/2006/relationships"};

// expat's functions for memory know no parser, so the one that runs in this thread counts.
thread_local size_t parser_bytes = 0;

// The size stands before each block.
constexpr size_t kHeader = alignof(std::max_align_t);

void* Allocate(size_t bytes) {
  if (bytes > kMaxParserBytes - std::min(kMaxParserBytes, parser_bytes)) return nullptr;
  auto* const block = static_cast<char*>(std::malloc(bytes + kHeader));
  if (block == nullptr) return nullptr;
  std::memcpy(block, &bytes, sizeof bytes);
  parser_bytes += bytes;
  return block + kHeader;
}

void Free(void* at) {
  if (at == nullptr) return;
  char* const block = static_cast<char*>(at) - kHeader;
  size_t bytes = 0;
  std::memcpy(&bytes, block, sizeof bytes);
  parser_bytes -= std::min(parser_bytes, bytes);
  std::free(block);
}

void* Reallocate(void* at, size_t bytes) {
  void* const moved = Allocate(bytes);
  if (moved == nullptr || at == nullptr) return moved;
  size_t before = 0;
  std::memcpy(&before, static_cast<char*>(at) - kHeader, sizeof before);
  std::memcpy(moved, at, std::min(before, bytes));
  Free(at);
  return moved;
}

constexpr XML_Memory_Handling_Suite kMemory{&Allocate, &Reallocate, &Free};

std::string_view LocalName(std::string_view name) {
  const size_t at = name.rfind(kSeparator);
  return at == std::string_view::npos ? name : name.substr(at + 1);
}

// A name without a namespace counts: some files forget to declare it.
bool IsRead(std::string_view name) {
  if (name.find(kSeparator) == std::string_view::npos) return true;
  for (const std::string_view known : kNamespaces) {
    if (name.substr(0, known.size()) == known) return true;
  }
  return false;
}

}  // namespace

const char* Attributes::Find(std::string_view name) const {
  for (const char** at = list_; *at != nullptr; at += 2) {
    if (LocalName(at[0]) == name) return at[1];
  }
  return nullptr;
}

struct XmlEvents::Impl {
  std::string part;
  LoadBudget& budget;
  Begin begin;
  End end;
  XML_Parser parser = nullptr;
  int depth = 0;
  int left_out = 0;  // the depth of the outermost element that is left out; 0: none
  absl::Status status = absl::OkStatus();
  MemoryCharge charge = MemoryCharge(&MemoryOf(budget.job()));  // of the parser

  absl::Status Invalid(std::string_view what) const {
    return budget.Invalid(part, ", line ", XML_GetCurrentLineNumber(parser), ": ", std::string(what));
  }
  void Stop(absl::Status why) {
    if (!status.ok()) return;
    status = std::move(why);
    XML_StopParser(parser, XML_FALSE);
  }
  // Runs a function between expat's frames, which no exception may cross.
  template <typename Call>
  void Guard(const Call& call) {
    if (!status.ok()) return;
    try {
      if (absl::Status s = call(); !s.ok()) Stop(std::move(s));
    } catch (const std::bad_alloc&) {
      Stop(absl::ResourceExhaustedError("3MF: not enough memory"));
    }
  }

  static void XMLCALL OnBegin(void* user, const char* name, const char** attributes) {
    auto& self = *static_cast<Impl*>(user);
    ++self.depth;
    if (self.left_out > 0 && self.status.ok() && self.depth <= kMaxDepth) return;
    self.Guard([&]() -> absl::Status {
      if (self.depth > kMaxDepth) return self.Invalid(absl::StrCat("more than ", kMaxDepth, " levels of elements"));
      if (!IsRead(name)) {
        self.left_out = self.depth;
        return absl::OkStatus();
      }
      return self.begin(LocalName(name), Attributes(attributes));
    });
  }
  static void XMLCALL OnEnd(void* user, const char* name) {
    auto& self = *static_cast<Impl*>(user);
    const int depth = self.depth--;
    if (self.left_out > 0) {
      if (depth == self.left_out) self.left_out = 0;
      return;
    }
    self.Guard([&] { return self.end(LocalName(name)); });
  }
  static void XMLCALL OnDoctype(void* user, const char*, const char*, const char*, int) {
    auto& self = *static_cast<Impl*>(user);
    self.Guard([&] { return self.Invalid("a document type, which 3MF forbids"); });
  }
};

XmlEvents::XmlEvents(std::string part, LoadBudget& budget, Begin begin, End end)
    : impl_(new Impl{std::move(part), budget, std::move(begin), std::move(end)}) {
  parser_bytes = 0;
  impl_->parser = XML_ParserCreate_MM(nullptr, &kMemory, "|");
  if (impl_->parser == nullptr) return;
  // Without a salt expat asks the system for one, which a sandbox may forbid. Files know neither addresses nor time.
  const auto salt = reinterpret_cast<uintptr_t>(impl_.get()) ^
                    static_cast<uintptr_t>(std::chrono::steady_clock::now().time_since_epoch().count());
  XML_SetHashSalt(impl_->parser, static_cast<unsigned long>(salt) | 1);
  XML_SetUserData(impl_->parser, impl_.get());
  XML_SetElementHandler(impl_->parser, &Impl::OnBegin, &Impl::OnEnd);
  XML_SetStartDoctypeDeclHandler(impl_->parser, &Impl::OnDoctype);
}

XmlEvents::~XmlEvents() {
  if (impl_->parser != nullptr) XML_ParserFree(impl_->parser);
}

absl::Status XmlEvents::Parse(std::span<const uint8_t> piece) {
  if (impl_->parser == nullptr) return absl::ResourceExhaustedError("3MF: not enough memory");
  // Its lists grow to twice their size, and are copied then.
  const uint64_t most = std::min<uint64_t>(kMaxParserBytes, 3 * parser_bytes + 4 * piece.size());
  if (most > impl_->charge.bytes()) {
    absl::Status full = impl_->charge.Grow(most - impl_->charge.bytes(), "3MF: the XML parser:");
    if (!full.ok()) return full;
  }
  const auto* const text = reinterpret_cast<const char*>(piece.data());
  if (XML_Parse(impl_->parser, text, int(piece.size()), piece.empty()) != XML_STATUS_ERROR) return absl::OkStatus();
  if (!impl_->status.ok()) return impl_->status;
  const XML_Error error = XML_GetErrorCode(impl_->parser);
  if (error == XML_ERROR_NO_MEMORY) {
    return impl_->Invalid(absl::StrCat("an element needs more than ", kMaxParserBytes, " bytes"));
  }
  return impl_->Invalid(XML_ErrorString(error));
}

absl::Status XmlEvents::Finish() {
  return Parse({});
}

uint64_t XmlEvents::line() const {
  return XML_GetCurrentLineNumber(impl_->parser);
}

}  // namespace voxelpipe::threemf
