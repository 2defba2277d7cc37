#include "calls/raw_message.h"

#include <cstdint>
#include <optional>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

namespace voxelpipe {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

// Bytes of the mesh fields up to the end of `in`; nothing where it breaks before.
std::optional<uint64_t> CountMeshBytes(CodedInputStream& in, const MeshFields& fields) {
  uint64_t bytes = 0;
  while (const uint32_t tag = in.ReadTag()) {
    const int field = WireFormatLite::GetTagFieldNumber(tag);
    const bool mesh = field == fields.own, inner = field == fields.inner;
    if (WireFormatLite::GetTagWireType(tag) != WireFormatLite::WIRETYPE_LENGTH_DELIMITED || (!mesh && !inner)) {
      if (!WireFormatLite::SkipField(&in, tag)) return std::nullopt;
      continue;
    }
    int length = 0;
    if (!in.ReadVarintSizeAsInt(&length)) return std::nullopt;
    if (mesh) {
      if (!in.Skip(length)) return std::nullopt;
      bytes += uint64_t(length);
      continue;
    }
    const CodedInputStream::Limit limit = in.PushLimit(length);
    const std::optional<uint64_t> of_inner = CountMeshBytes(in, {fields.of_inner, 0, 0});
    if (!of_inner) return std::nullopt;
    bytes += *of_inner;
    in.PopLimit(limit);
  }
  if (!in.ConsumedEntireMessage()) return std::nullopt;
  return bytes;
}

}  // namespace

absl::Status CheckSettingsBytes(grpc::ByteBuffer& bytes, const MeshFields& fields) {
  if (bytes.Length() <= kMaxSettingsBytes) return absl::OkStatus();
  grpc::ProtoBufferReader reader(&bytes);
  CodedInputStream in(&reader);
  const std::optional<uint64_t> mesh_bytes = CountMeshBytes(in, fields);
  if (!mesh_bytes) return absl::InvalidArgumentError("message: its fields do not end where it ends");
  const uint64_t settings_bytes = bytes.Length() - *mesh_bytes;
  if (settings_bytes <= kMaxSettingsBytes) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("message: ", settings_bytes, " bytes beside the mesh's; at most ",
                                                 kMaxSettingsBytes, " are possible"));
}

}  // namespace voxelpipe
