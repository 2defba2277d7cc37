#include "reply/piece_view.h"

#include <algorithm>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include "base/checksum/crc32c.h"

namespace voxelpipe {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

constexpr uint32_t Tag(int field, WireFormatLite::WireType type) {
  return WireFormatLite::MakeTag(field, type);
}

constexpr uint32_t kPiece = Tag(v1::VoxelizeResponse::kPieceFieldNumber, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
constexpr uint32_t kTarget = Tag(v1::ResultPiece::kTargetFieldNumber, WireFormatLite::WIRETYPE_VARINT);
constexpr uint32_t kOffset = Tag(v1::ResultPiece::kOffsetFieldNumber, WireFormatLite::WIRETYPE_VARINT);
constexpr uint32_t kCrc32c = Tag(v1::ResultPiece::kCrc32CFieldNumber, WireFormatLite::WIRETYPE_FIXED32);
constexpr uint32_t kRawBytes = Tag(v1::ResultPiece::kRawBytesFieldNumber, WireFormatLite::WIRETYPE_VARINT);
constexpr uint32_t kData = Tag(v1::ResultPiece::kDataFieldNumber, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);

bool ReadLength(CodedInputStream& in, int& bytes) {
  uint32_t length = 0;
  if (!in.ReadVarint32(&length) || length > uint32_t(INT32_MAX)) return false;
  bytes = int(length);
  return true;
}

bool ReadData(CodedInputStream& in, PieceView& view) {
  int left = 0;
  if (!ReadLength(in, left)) return false;
  view.data.clear();  // the last occurrence of a field counts
  while (left > 0) {
    const void* part = nullptr;
    int bytes = 0;
    if (!in.GetDirectBufferPointer(&part, &bytes)) return false;
    bytes = std::min(bytes, left);
    view.data.emplace_back(static_cast<const uint8_t*>(part), size_t(bytes));
    if (!in.Skip(bytes)) return false;
    left -= bytes;
  }
  return true;
}

bool ReadField(CodedInputStream& in, uint32_t tag, PieceView& view) {
  switch (tag) {
    case kTarget: return in.ReadVarint32(&view.target);
    case kOffset: return in.ReadVarint64(&view.offset);
    case kCrc32c: return in.ReadLittleEndian32(&view.crc32c);
    case kRawBytes: return in.ReadVarint64(&view.raw_bytes);
    case kData: return ReadData(in, view);
    default: return WireFormatLite::SkipField(&in, tag);
  }
}

}  // namespace

PieceView::PieceView(const v1::ResultPiece& piece)
    : target(piece.target()), crc32c(piece.crc32c()), offset(piece.offset()), raw_bytes(piece.raw_bytes()) {
  if (!piece.data().empty())
    data.emplace_back(reinterpret_cast<const uint8_t*>(piece.data().data()), piece.data().size());
}

uint64_t PieceView::data_bytes() const {
  uint64_t bytes = 0;
  for (const std::span<const uint8_t> part : data) bytes += part.size();
  return bytes;
}

uint32_t PieceView::DataCrc32c() const {
  uint32_t crc = 0;  // of no bytes
  for (const std::span<const uint8_t> part : data) crc = ExtendCrc32c(crc, part);
  return crc;
}

const PieceView* PieceViewer::View(grpc::ByteBuffer& message) {
  grpc::ProtoBufferReader reader(&message);  // points into the message
  return reader.status().ok() && Read(reader) ? &view_ : nullptr;
}

bool PieceViewer::Read(google::protobuf::io::ZeroCopyInputStream& stream) {
  view_.target = view_.crc32c = 0;
  view_.offset = view_.raw_bytes = 0;
  view_.data.clear();
  CodedInputStream in(&stream);
  int bytes = 0;
  if (in.ReadTag() != kPiece || !ReadLength(in, bytes)) return false;
  const CodedInputStream::Limit limit = in.PushLimit(bytes);
  while (const uint32_t tag = in.ReadTag()) {
    if (!ReadField(in, tag, view_)) return false;
  }
  if (!in.ConsumedEntireMessage() || in.BytesUntilLimit() != 0) return false;
  in.PopLimit(limit);
  return in.ReadTag() == 0 && in.ConsumedEntireMessage();
}

}  // namespace voxelpipe
