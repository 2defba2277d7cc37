#include "web/http/request_body.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "state/service_state.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// A block doubles up to this size, so that a short body takes little memory and a long one few blocks.
constexpr size_t kFirstBlockBytes = 4 << 10, kLargestBlockBytes = 1 << 20;
constexpr std::chrono::milliseconds kUploadRetryAfter{1000};

}  // namespace

RequestBody::RequestBody(size_t head_bytes, uint64_t max_bytes, ByteBudget& budget, std::chrono::milliseconds idle)
    : head_bytes_(head_bytes), max_bytes_(max_bytes), idle_(idle), share_(budget) {}

RequestBody::Took RequestBody::Append(std::string_view piece) {
  const size_t of_head = std::min(piece.size(), head_bytes_ - head_.size());
  head_.append(piece.substr(0, of_head));
  bytes_ += piece.size();
  if (status_.ok()) Keep(piece.substr(of_head));
  if (bytes_ > 2 * max_bytes_ + head_bytes_) return Took::kEndless;
  const auto now = std::chrono::steady_clock::now();
  if (bytes_ - mark_bytes_ >= kMinUploadBytes) {
    mark_ = now;
    mark_bytes_ = bytes_;
  }
  return now - mark_ > idle_ ? Took::kIdle : Took::kGood;
}

void RequestBody::Keep(std::string_view piece) {
  if (bytes_ > max_bytes_ + head_bytes_) {
    Refuse(absl::ResourceExhaustedError(absl::StrCat("the message is larger than the limit of ", max_bytes_,
                                                     " bytes; larger meshes go through gRPC's Voxelize")));
    return;
  }
  while (!piece.empty()) {
    if (blocks_.empty() || blocks_.back().size() == blocks_.back().capacity()) {
      const size_t last = blocks_.empty() ? kFirstBlockBytes / 2 : blocks_.back().capacity();
      const size_t bytes = std::min(2 * last, kLargestBlockBytes);
      if (!share_.TryGrow(bytes)) {
        Refuse(BusyError("too many meshes are being uploaded at the same time", kUploadRetryAfter));
        return;
      }
      blocks_.emplace_back().reserve(bytes);
    }
    std::string& block = blocks_.back();
    const size_t bytes = std::min(piece.size(), block.capacity() - block.size());
    block.append(piece.substr(0, bytes));
    piece.remove_prefix(bytes);
  }
}

void RequestBody::Refuse(absl::Status status) {
  status_ = std::move(status);
  blocks_.clear();
  share_.ShrinkTo(0);
}

grpc::ByteBuffer RequestBody::Take() {
  std::vector<grpc::Slice> slices;
  for (std::string& block : blocks_) {
    auto kept = std::make_unique<std::string>(std::move(block));
    char* const data = kept->data();
    const size_t size = kept->size();
    slices.emplace_back(
        data, size, [](void* text) { delete static_cast<std::string*>(text); }, kept.release());
  }
  blocks_.clear();
  share_.ShrinkTo(0);
  return {slices.data(), slices.size()};
}

}  // namespace voxelpipe
