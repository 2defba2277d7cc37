// Source: L. Masinter, "The 'data' URL scheme", RFC 2397 (1998).
#include "load/base/data_uri.h"

#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "load/base/text_reader.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxHeadBytes = 64 << 10;    // before the comma
constexpr size_t kCharactersAStep = 1 << 18;  // of a URI, between two polls of the job; a multiple of 4

int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

absl::StatusOr<std::string> PercentDecode(const JobContext& job, std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (size_t i = 0; i < text.size(); ++i) {
    if (out.size() % kCharactersAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    if (text[i] != '%') {
      out.push_back(text[i]);
      continue;
    }
    const int high = i + 2 < text.size() ? HexDigit(text[i + 1]) : -1;
    const int low = i + 2 < text.size() ? HexDigit(text[i + 2]) : -1;
    if (high < 0 || low < 0)
      return absl::InvalidArgumentError(absl::StrCat("a broken percent escape at character ", i));
    out.push_back(static_cast<char>(high * 16 + low));
    i += 2;
  }
  return out;
}

constexpr std::string_view kDataScheme = "data:";
constexpr absl::string_view kNameParameter = "name=";

// The text between "data:" and the comma.
struct DataHead {
  std::string media_type;  // lower case
  std::string name;        // the parameter of this name, percent escapes not decoded
  bool base64 = false;
};

// Source: RFC 2397. Scheme, media type and the names of parameters are case-insensitive. A parameter is name=value; a
// bare name is an encoding, of which base64 is the only one.
absl::StatusOr<DataHead> ReadHead(std::string_view text) {
  DataHead head;
  bool first = true;
  for (absl::string_view part : absl::StrSplit(absl::string_view(text.data(), text.size()), ';')) {
    part = absl::StripAsciiWhitespace(part);
    if (std::exchange(first, false)) {
      head.media_type = absl::AsciiStrToLower(part);
    } else if (absl::EqualsIgnoreCase(part, "base64")) {
      head.base64 = true;
    } else if (absl::StartsWithIgnoreCase(part, kNameParameter)) {
      head.name = std::string(part.substr(kNameParameter.size()));
    } else if (!part.empty() && !absl::StrContains(part, '=')) {
      return absl::InvalidArgumentError(
          absl::StrCat("a data: URI of the encoding ", Quote({part.data(), part.size()}), ", which is unknown"));
    }
  }
  return head;
}

// Abseil's decoder skips white space and tolerates wrong padding, so the alphabet is checked here.
absl::Status CheckBase64(const JobContext& job, std::string_view text) {
  size_t end = text.size();
  while (end > 0 && text.size() - end < 2 && text[end - 1] == '=') --end;
  for (size_t i = 0; i < end; ++i) {
    if (i % kCharactersAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    const char c = text[i];
    const bool good =
        (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '+' || c == '/';
    if (!good) return absl::InvalidArgumentError(absl::StrCat("a character that is not base64 at ", i));
  }
  if (end % 4 == 1) return absl::InvalidArgumentError("base64 of an impossible length");
  return absl::OkStatus();
}

}  // namespace

bool IsDataUri(std::string_view uri) {
  return absl::StartsWithIgnoreCase(absl::string_view(uri.data(), uri.size()),
                                    {kDataScheme.data(), kDataScheme.size()});
}

absl::StatusOr<DataUri> DecodeDataUri(const JobContext& job, std::string_view uri) {
  const size_t comma = uri.find(',');
  if (comma == std::string_view::npos) return absl::InvalidArgumentError("a data: URI without a comma");
  if (comma > kMaxHeadBytes) {
    return absl::InvalidArgumentError(absl::StrCat("a data: URI with a head of more than ", kMaxHeadBytes, " bytes"));
  }
  std::string_view data = uri.substr(comma + 1);
  const absl::StatusOr<DataHead> head = ReadHead(uri.substr(kDataScheme.size(), comma - kDataScheme.size()));
  if (!head.ok()) return head.status();
  const bool base64 = head->base64;
  DataUri out;
  out.media_type = head->media_type;
  absl::StatusOr<std::string> name = PercentDecode(job, head->name);
  if (!name.ok()) return name.status();
  out.name = *std::move(name);

  std::string unescaped;
  if (!base64 || data.find('%') != std::string_view::npos) {
    absl::StatusOr<std::string> text = PercentDecode(job, data);
    if (!text.ok()) return text.status();
    unescaped = *std::move(text);
    data = unescaped;
  }
  if (!base64) {
    out.bytes.assign(data.begin(), data.end());
    return out;
  }
  if (absl::Status bad = CheckBase64(job, data); !bad.ok()) return bad;
  out.bytes.reserve(data.size() / 4 * 3 + 3);
  for (size_t begin = 0; begin < data.size(); begin += kCharactersAStep) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    const std::string_view step = data.substr(begin, kCharactersAStep);
    std::string binary;
    if (!absl::Base64Unescape(absl::string_view(step.data(), step.size()), &binary)) {
      return absl::InvalidArgumentError("broken base64");
    }
    out.bytes.insert(out.bytes.end(), binary.begin(), binary.end());
  }
  return out;
}

}  // namespace voxelpipe
