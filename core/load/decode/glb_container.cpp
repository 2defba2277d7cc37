// GLB: a 12-byte header and chunks (glTF 2.0 specification, section 4.4).
#include "load/decode/glb_container.h"

#include <cstring>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr uint32_t kMagic = 0x46546C67;      // "glTF"
constexpr uint32_t kJsonChunk = 0x4E4F534A;  // "JSON"
constexpr uint32_t kBinChunk = 0x004E4942;   // "BIN\0"
constexpr uint64_t kHeaderBytes = 12, kChunkHeaderBytes = 8;
constexpr uint64_t kChunksAStep = 1 << 14;  // between two polls of the job

uint32_t ReadU32(std::span<const uint8_t> bytes, uint64_t at) {
  return static_cast<uint32_t>(bytes[at]) | static_cast<uint32_t>(bytes[at + 1]) << 8 |
         static_cast<uint32_t>(bytes[at + 2]) << 16 | static_cast<uint32_t>(bytes[at + 3]) << 24;
}

template <typename... Parts>
absl::Status Broken(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat("GLB: ", parts...));
}

}  // namespace

void AddLeftOverBytes(const GlbChunks& chunks, WarningList& warnings) {
  if (chunks.left_over_bytes == 0) return;
  warnings.Add(
      WarningCode::kNonconformingFile, "",
      absl::StrCat(chunks.left_over_bytes, " bytes after the length that the GLB header declares are ignored"));
}

absl::StatusOr<GlbChunks> SplitGlb(const JobContext& job, std::span<const uint8_t> bytes) {
  if (bytes.size() < 4 || ReadU32(bytes, 0) != kMagic) return Broken("byte 0: the magic 'glTF' is missing");
  if (bytes.size() < kHeaderBytes) {
    return Broken("the header needs ", kHeaderBytes, " bytes, the file has ", bytes.size());
  }
  const uint32_t version = ReadU32(bytes, 4);
  if (version == 1) return Broken("byte 4: glTF 1.0 is not supported, only 2.0");
  if (version != 2) return Broken("byte 4: container version ", version, " is not supported (glTF 2.0 has version 2)");
  const uint64_t length = ReadU32(bytes, 8);
  if (length > bytes.size() || length < kHeaderBytes) {
    return Broken("byte 8: the length field says ", length, " bytes, the file has ", bytes.size());
  }

  GlbChunks chunks;
  chunks.left_over_bytes = bytes.size() - length;
  bool have_json = false;
  uint64_t chunk = 0;
  for (uint64_t at = kHeaderBytes; at < length;) {
    if (chunk++ % kChunksAStep == 0) {
      if (absl::Status over = job.Check(); !over.ok()) return over;
    }
    if (length - at < kChunkHeaderBytes) return Broken("byte ", at, ": a chunk header is cut off");
    const uint64_t size = ReadU32(bytes, at);
    const uint32_t type = ReadU32(bytes, at + 4);
    const uint64_t data = at + kChunkHeaderBytes;
    if (size > length - data) {
      return Broken("byte ", at, ": a chunk of ", size, " bytes overruns the file of ", length, " bytes");
    }
    if (!have_json && type != kJsonChunk) return Broken("byte ", at + 4, ": the first chunk is not JSON");
    if (type == kJsonChunk) {
      if (have_json) return Broken("byte ", at + 4, ": a second JSON chunk");
      chunks.json = std::string_view(reinterpret_cast<const char*>(bytes.data() + data), size);
      have_json = true;
    } else if (type == kBinChunk) {
      if (chunks.binary) return Broken("byte ", at + 4, ": a second BIN chunk");
      chunks.binary = bytes.subspan(data, size);
    }  // Chunks of other types are ignored, as the specification requires.
    at = data + size;
  }
  if (!have_json) return Broken("byte ", kHeaderBytes, ": there is no JSON chunk");
  return chunks;
}

}  // namespace voxelpipe
