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

constexpr uint32_t kPiece = Tag(v1::VoxelizeResponse::kPiecesFieldNumber, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
constexpr uint32_t kArray = Tag(v1::ResultPiece::kArrayFieldNumber, WireFormatLite::WIRETYPE_VARINT);
constexpr uint32_t kOffset = Tag(v1::ResultPiece::kOffsetFieldNumber, WireFormatLite::WIRETYPE_VARINT);
constexpr uint32_t kCrc32c = Tag(v1::ResultPiece::kCrc32CFieldNumber, WireFormatLite::WIRETYPE_FIXED32);
constexpr uint32_t kUncompressedBytes =
    Tag(v1::ResultPiece::kUncompressedBytesFieldNumber, WireFormatLite::WIRETYPE_VARINT);
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

// A varint of either size in protobuf's way: excess bits are dropped.
template <typename Number>
bool ReadNumber(CodedInputStream& in, Number& number) {
  uint64_t bits = 0;
  if (!in.ReadVarint64(&bits)) return false;
  number = Number(bits);
  return true;
}

bool ReadField(CodedInputStream& in, uint32_t tag, PieceView& view) {
  switch (tag) {
    case kArray: return ReadNumber(in, view.array);
    case kOffset: return ReadNumber(in, view.offset);
    case kCrc32c: return in.ReadLittleEndian32(&view.crc32c);
    case kUncompressedBytes: return ReadNumber(in, view.uncompressed_bytes.emplace());
    case kData: return ReadData(in, view);
    default: return WireFormatLite::SkipField(&in, tag);
  }
}

bool ReadPiece(CodedInputStream& in, PieceView& view) {
  int bytes = 0;
  if (!ReadLength(in, bytes)) return false;
  const CodedInputStream::Limit limit = in.PushLimit(bytes);
  while (const uint32_t tag = in.ReadTag()) {
    if (!ReadField(in, tag, view)) return false;
  }
  if (!in.ConsumedEntireMessage() || in.BytesUntilLimit() != 0) return false;
  in.PopLimit(limit);
  return true;
}

}  // namespace

PieceView::PieceView(const v1::ResultPiece& piece)
    : array(piece.array()), crc32c(piece.crc32c()), offset(piece.offset()) {
  if (piece.has_uncompressed_bytes()) uncompressed_bytes = piece.uncompressed_bytes();
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

std::span<const PieceView> PieceViewer::View(grpc::ByteBuffer& message) {
  grpc::ProtoBufferReader reader(&message);  // points into the message
  if (!reader.status().ok() || !Read(reader)) return {};
  return {views_.data(), count_};
}

bool PieceViewer::Read(google::protobuf::io::ZeroCopyInputStream& stream) {
  count_ = 0;
  CodedInputStream in(&stream);
  while (const uint32_t tag = in.ReadTag()) {
    if (tag != kPiece || !ReadPiece(in, Next())) return false;
  }
  return in.ConsumedEntireMessage();
}

PieceView& PieceViewer::Next() {
  if (count_ == views_.size()) views_.emplace_back();
  PieceView& view = views_[count_++];
  view.array = 0;
  view.crc32c = 0;
  view.offset = 0;
  view.uncompressed_bytes.reset();
  view.data.clear();
  return view;
}

}  // namespace voxelpipe
