#include "reply/raw_message.h"

#include <cstdint>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

namespace voxelpipe {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

enum class Fields { kPossible, kBroken, kTooMany };

// Counts bytes outside the mesh, and stops above the limit: fields are skipped one by one, and 64 MiB may hold 32
// million.
class SettingsCounter {
 public:
  explicit SettingsCounter(CodedInputStream& in) : in_(in) {}

  // Up to the current limit of `in`.
  Fields Count(const MeshFields& fields) {
    for (;;) {
      const int begin = in_.CurrentPosition();
      const uint32_t tag = in_.ReadTag();
      if (tag == 0) return in_.ConsumedEntireMessage() ? Fields::kPossible : Fields::kBroken;
      const int field = WireFormatLite::GetTagFieldNumber(tag);
      const bool mesh = field == fields.own, inner = field == fields.inner;
      int length = 0;
      if (WireFormatLite::GetTagWireType(tag) != WireFormatLite::WIRETYPE_LENGTH_DELIMITED || (!mesh && !inner)) {
        if (!WireFormatLite::SkipField(&in_, tag)) return Fields::kBroken;
      } else if (!in_.ReadVarintSizeAsInt(&length)) {
        return Fields::kBroken;
      }
      bytes_ += uint64_t(in_.CurrentPosition() - begin);
      if (bytes_ > kMaxSettingsBytes) return Fields::kTooMany;
      if (mesh && !in_.Skip(length)) return Fields::kBroken;
      if (inner && length > 0) {
        const CodedInputStream::Limit limit = in_.PushLimit(length);
        if (const Fields found = Count({fields.of_inner, 0, 0}); found != Fields::kPossible) return found;
        in_.PopLimit(limit);
      }
    }
  }

 private:
  CodedInputStream& in_;
  uint64_t bytes_ = 0;  // outside the mesh
};

}  // namespace

absl::Status CheckSettingsBytes(grpc::ByteBuffer& bytes, const MeshFields& fields) {
  if (bytes.Length() <= kMaxSettingsBytes) return absl::OkStatus();
  grpc::ProtoBufferReader reader(&bytes);
  CodedInputStream in(&reader);
  switch (SettingsCounter(in).Count(fields)) {
    case Fields::kPossible: return absl::OkStatus();
    case Fields::kBroken: return absl::InvalidArgumentError("message: its fields do not end where it ends");
    case Fields::kTooMany: break;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("message: at most ", kMaxSettingsBytes, " bytes beside the mesh's are possible"));
}

}  // namespace voxelpipe
