#include "load/gltf/document/gltf_buffers.h"

#include <algorithm>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "base/checked.h"
#include "base/limit_error.h"
#include "load/base/data_uri.h"
#include "load/decode/meshopt.h"
#include "load/gltf/document/json_guard.h"

namespace voxelpipe::gltf {
namespace {

constexpr uint64_t kMinElements = 65'536;  // that every file may declare

// The buffers that may lack data: flagged as a fallback, or used only by views whose bytes are compressed in another
// buffer.
std::vector<bool> Placeholders(const Document& document) {
  const size_t count = document.buffers.size();
  std::vector<bool> read(count), replaced(count), out(count);
  for (const ViewDecl& view : document.views) {
    if (view.meshopt) read[view.meshopt->buffer] = true;
    (view.meshopt ? replaced : read)[view.buffer] = true;
  }
  for (size_t i = 0; i < count; ++i) out[i] = document.buffers[i].fallback || (replaced[i] && !read[i]);
  return out;
}

}  // namespace

absl::Status Budget::Take(uint64_t elements, uint64_t bytes_each, const std::string& what, MemoryCharge& charge) const {
  if (absl::Status over = job_.Check(); !over.ok()) return over;
  return charge.Grow(elements, bytes_each, "glTF: " + what + ":");
}

absl::Status Budget::CheckDeclared(uint64_t elements, uint64_t bytes_each, const std::string& what) const {
  const uint64_t most = std::max(kMinElements, file_bytes_ * limits_.max_elements_per_byte);  // a file's size is small
  if (elements <= most) return absl::OkStatus();
  return MakeLimitError(absl::StrCat("glTF: ", what, ": ", elements, " elements without data in a file of ",
                                     file_bytes_, " bytes; the limit max_elements_per_byte allows ", most),
                        {CheckedMul(elements, bytes_each).value_or(UINT64_MAX), most * bytes_each, 0});
}

bool IsOfFile(const absl::Status& error) {
  return absl::IsInvalidArgument(error) || (absl::IsResourceExhausted(error) && !IsInUseByOthers(error));
}

absl::StatusOr<Buffers> Buffers::Resolve(Document& document, std::optional<std::span<const uint8_t>> chunk,
                                         Budget& budget) {
  Buffers buffers;
  buffers.document_ = &document;
  buffers.charge_ = budget.NewCharge();
  buffers.owned_.resize(document.buffers.size());
  buffers.bytes_.resize(document.buffers.size());
  buffers.decoded_views_.resize(document.views.size());
  const std::vector<bool> placeholders = Placeholders(document);
  for (size_t i = 0; i < document.buffers.size(); ++i) {
    BufferDecl& decl = document.buffers[i];
    const std::string where = absl::StrCat("buffer ", i);
    if (!decl.uri) {
      if (i == 0 && chunk) {
        buffers.bytes_[i] = *chunk;
      } else if (placeholders[i]) {
        continue;
      } else {
        return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": no uri, and no GLB chunk holds its data"));
      }
    } else if (IsDataUri(*decl.uri)) {
      // The bytes, and a copy while they are decoded.
      const uint64_t before = buffers.charge_.bytes();
      if (absl::Status full = budget.Take(decl.uri->size(), 2, where, buffers.charge_); !full.ok()) return full;
      absl::StatusOr<DataUri> data = DecodeDataUri(budget.job(), *decl.uri);
      if (!data.ok()) return WithText(data.status(), absl::StrCat("glTF: ", where, ": ", data.status().message()));
      decl.uri->clear();
      decl.uri->shrink_to_fit();
      buffers.owned_[i] = std::move(data->bytes);
      buffers.charge_.ShrinkTo(before + buffers.owned_[i].size());
      buffers.bytes_[i] = buffers.owned_[i];
    } else {
      return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": the URI ", Quoted(*decl.uri),
                                                     " is not read: only data: URIs and the GLB chunk are"));
    }
    if (decl.byte_length > buffers.bytes_[i].size()) {
      return absl::InvalidArgumentError(absl::StrCat("glTF: ", where, ": byteLength is ", decl.byte_length,
                                                     ", its data has ", buffers.bytes_[i].size(), " bytes"));
    }
    buffers.bytes_[i] = buffers.bytes_[i].first(decl.byte_length);
  }
  return buffers;
}

absl::StatusOr<std::vector<uint8_t>> Buffers::Decode(const MeshoptDecl& decl, Budget& budget) {
  const std::span<const uint8_t> buffer = bytes_[decl.buffer];
  if (buffer.size() < decl.offset + decl.length) {
    return absl::InvalidArgumentError(absl::StrCat("meshopt compression: buffer ", decl.buffer, " has no data"));
  }
  MemoryCharge charge = budget.NewCharge();
  if (absl::Status full = budget.Take(decl.count, decl.stride, "meshopt compression", charge); !full.ok()) return full;
  MeshoptView view;
  view.count = decl.count;
  view.byte_stride = decl.stride;
  view.mode = decl.mode;
  view.filter = decl.filter;
  view.khr = decl.khr;
  absl::StatusOr<std::vector<uint8_t>> bytes = DecodeMeshopt(buffer.subspan(decl.offset, decl.length), view);
  if (bytes.ok()) charge_.Absorb(std::move(charge));
  return bytes;
}

absl::StatusOr<std::span<const uint8_t>> Buffers::View(uint32_t index, Budget& budget) {
  const ViewDecl& view = document_->views[index];
  if (!view.meshopt) {
    const std::span<const uint8_t> buffer = bytes_[view.buffer];
    if (buffer.size() < view.offset + view.length) {
      return absl::InvalidArgumentError(
          absl::StrCat("glTF: bufferView ", index, ": buffer ", view.buffer, " is a placeholder without data"));
    }
    return buffer.subspan(view.offset, view.length);
  }
  std::vector<uint8_t>& decoded = decoded_views_[index];
  if (decoded.empty()) {
    absl::StatusOr<std::vector<uint8_t>> bytes = Decode(*view.meshopt, budget);
    if (!bytes.ok()) {
      return WithText(bytes.status(), absl::StrCat("glTF: bufferView ", index, ": ",
                                                   absl::StripPrefix(bytes.status().message(), "glTF: ")));
    }
    decoded = *std::move(bytes);
  }
  return std::span<const uint8_t>(decoded);
}

uint64_t Buffers::Stride(uint32_t index) const {
  const ViewDecl& view = document_->views[index];
  return view.meshopt ? view.meshopt->stride : view.stride;
}

}  // namespace voxelpipe::gltf
