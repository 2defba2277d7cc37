#include "reply/raw_message.h"

#include <algorithm>
#include <cstdint>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

#include "mesh/placed_mesh.h"

namespace voxelpipe {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

enum class Fields { kPossible, kBroken, kTooMany };

// Counts bytes outside the mesh, and stops above the limit: fields are skipped one by one, and 64 MiB may hold 32
// million.
class SettingsCounter {
 public:
  SettingsCounter(CodedInputStream& in, std::span<const MeshPath> paths) : in_(in), paths_(paths) {}

  // Up to the current limit of `in`, within a message at the end of the first `depth` fields of the paths in `within`,
  // one bit each.
  Fields Count(uint32_t within, size_t depth) {
    for (;;) {
      const int begin = in_.CurrentPosition();
      const uint32_t tag = in_.ReadTag();
      if (tag == 0) return in_.ConsumedEntireMessage() ? Fields::kPossible : Fields::kBroken;
      const bool has_length = WireFormatLite::GetTagWireType(tag) == WireFormatLite::WIRETYPE_LENGTH_DELIMITED;
      const auto [mesh, deeper, placed] =
          Follow(has_length ? WireFormatLite::GetTagFieldNumber(tag) : 0, within, depth);
      if (placed) free_ = placed_++ < kMaxPlacedMeshes ? kPlacedMeshBytes : 0;
      int length = 0;
      if (!mesh && deeper == 0) {
        if (!WireFormatLite::SkipField(&in_, tag)) return Fields::kBroken;
      } else if (!in_.ReadVarintSizeAsInt(&length)) {
        return Fields::kBroken;
      }
      // Fields of any length that no path goes through may take much more memory than bytes.
      Add(uint64_t(in_.CurrentPosition() - begin), mesh || deeper != 0 || !has_length);
      if (bytes_ > kMaxSettingsBytes) return Fields::kTooMany;
      if (mesh && !in_.Skip(length)) return Fields::kBroken;
      if (deeper != 0 && length > 0) {
        const CodedInputStream::Limit limit = in_.PushLimit(length);
        if (const Fields found = Count(deeper, depth + 1); found != Fields::kPossible) return found;
        in_.PopLimit(limit);
      }
      if (placed) free_ = 0;
    }
  }

 private:
  struct Step {
    bool mesh = false;    // the field has mesh bytes
    uint32_t deeper = 0;  // the paths that go on within it
    bool placed = false;  // the field is a placed mesh
  };
  Step Follow(int field, uint32_t within, size_t depth) const {
    Step step;
    if (field == 0) return step;
    for (size_t i = 0; i < paths_.size(); ++i) {
      const MeshPath& path = paths_[i];
      if ((within >> i & 1) == 0 || path.fields[depth] != field) continue;
      if (depth + 1 == path.fields.size() || path.fields[depth + 1] == 0) {
        step.mesh = true;
      } else {
        step.deeper |= uint32_t{1} << i;
        step.placed |= path.placed_depth != 0 && path.placed_depth == depth;
      }
    }
    return step;
  }

  void Add(uint64_t bytes, bool may_be_free) {
    const uint64_t free = may_be_free ? std::min(free_, bytes) : 0;
    free_ -= free;
    bytes_ += bytes - free;
  }

  CodedInputStream& in_;
  const std::span<const MeshPath> paths_;
  uint64_t bytes_ = 0;   // outside the mesh
  uint64_t free_ = 0;    // further bytes of a placed mesh that do not count
  uint64_t placed_ = 0;  // number of placed meshes so far
};

}  // namespace

absl::Status CheckSettingsBytes(grpc::ByteBuffer& bytes, std::span<const MeshPath> paths) {
  if (bytes.Length() <= kMaxSettingsBytes) return absl::OkStatus();
  grpc::ProtoBufferReader reader(&bytes);
  CodedInputStream in(&reader);
  switch (SettingsCounter(in, paths).Count(~uint32_t{0}, 0)) {
    case Fields::kPossible: return absl::OkStatus();
    case Fields::kBroken: return absl::InvalidArgumentError("message: its fields do not end where it ends");
    case Fields::kTooMany: break;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("message: at most ", kMaxSettingsBytes, " bytes beside the mesh's are possible"));
}

}  // namespace voxelpipe
