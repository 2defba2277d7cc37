#include "base/limit_error.h"

#include <charconv>
#include <string>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr char kUrl[] = "voxelpipe/limit_error";
constexpr char kInUseUrl[] = "voxelpipe/in_use_by_others";

// Parses one decimal number and the blank after it.
template <typename Number>
bool TakeNumber(std::string_view& text, Number& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (error != std::errc()) return false;
  text.remove_prefix(size_t(end - text.data()));
  if (!text.empty()) text.remove_prefix(1);
  return true;
}

}  // namespace

std::string ExactText(double number) {
  char text[32];
  return {text, std::to_chars(text, text + sizeof text, number).ptr};
}

absl::Status MakeLimitError(std::string_view message, const LimitError& numbers) {
  absl::Status status = absl::ResourceExhaustedError(absl::string_view(message.data(), message.size()));
  status.SetPayload(kUrl, absl::Cord(absl::StrCat(
                              numbers.need_bytes, " ", numbers.limit_bytes, " ", numbers.largest_resolution, " ",
                              ExactText(numbers.smallest_voxel_size.x), " ", ExactText(numbers.smallest_voxel_size.y),
                              " ", ExactText(numbers.smallest_voxel_size.z))));
  return status;
}

std::optional<LimitError> LimitErrorOf(const absl::Status& status) {
  const auto payload = status.GetPayload(kUrl);
  if (!payload) return std::nullopt;
  const std::string all(*payload);
  std::string_view text = all;
  LimitError numbers;
  if (!TakeNumber(text, numbers.need_bytes) || !TakeNumber(text, numbers.limit_bytes) ||
      !TakeNumber(text, numbers.largest_resolution) || !TakeNumber(text, numbers.smallest_voxel_size.x) ||
      !TakeNumber(text, numbers.smallest_voxel_size.y) || !TakeNumber(text, numbers.smallest_voxel_size.z)) {
    return std::nullopt;
  }
  return numbers;
}

absl::Status MarkInUseByOthers(absl::Status status) {
  status.SetPayload(kInUseUrl, absl::Cord());
  return status;
}

bool IsInUseByOthers(const absl::Status& status) {
  return status.GetPayload(kInUseUrl).has_value();
}

absl::Status WithText(const absl::Status& status, std::string_view text) {
  absl::Status out(status.code(), absl::string_view(text.data(), text.size()));
  status.ForEachPayload([&out](absl::string_view url, const absl::Cord& value) { out.SetPayload(url, value); });
  return out;
}

}  // namespace voxelpipe
