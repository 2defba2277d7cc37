// The wire format by hand: a field is its key (number and type) as a varint, then its value; submessages and bytes
// carry their length first; fields may come in any order.
#include "reply/response_coder.h"

#include <iterator>
#include <utility>

namespace voxelpipe {
namespace {

// Smaller pieces are copied: a slice with an owner costs an allocation and a reference count.
constexpr size_t kCopyBelow = 16 << 10;

enum WireType : uint32_t { kVarint = 0, kBytes = 2, kFixed32 = 5 };

void PutVarint(uint64_t value, std::string& out) {
  for (; value >= 0x80; value >>= 7) out.push_back(char(uint8_t(value) | 0x80));
  out.push_back(char(value));
}

void PutKey(int field, WireType type, std::string& out) {
  PutVarint(uint64_t(field) << 3 | type, out);
}

void PutLength(int field, uint64_t bytes, std::string& out) {
  PutKey(field, kBytes, out);
  PutVarint(bytes, out);
}

size_t VarintSize(uint64_t value) {
  size_t size = 1;
  for (; value >= 0x80; value >>= 7) ++size;
  return size;
}

// A piece up to its bytes, which come last.
std::string PieceHead(const CodedPiece& piece) {
  std::string head;
  if (piece.array != 0) {
    PutKey(v1::ResultPiece::kArrayFieldNumber, kVarint, head);
    PutVarint(piece.array, head);
  }
  if (piece.offset != 0) {
    PutKey(v1::ResultPiece::kOffsetFieldNumber, kVarint, head);
    PutVarint(piece.offset, head);
  }
  PutKey(v1::ResultPiece::kCrc32CFieldNumber, kFixed32, head);
  for (int shift = 0; shift < 32; shift += 8) head.push_back(char(uint8_t(piece.crc32c >> shift)));
  if (piece.uncompressed_bytes) {
    PutKey(v1::ResultPiece::kUncompressedBytesFieldNumber, kVarint, head);
    PutVarint(*piece.uncompressed_bytes, head);
  }
  PutLength(v1::ResultPiece::kDataFieldNumber, piece.data.size(), head);
  return head;
}

// A field of `bytes` bytes with its key and length; keys take a byte.
uint64_t FieldSize(uint64_t bytes) {
  return 1 + VarintSize(bytes) + bytes;
}

// Collects text and referenced bytes as slices.
class Slices {
 public:
  std::string text;

  void Add(const CodedPiece& piece) {
    if (piece.owner == nullptr || piece.data.size() < kCopyBelow) {
      text.append(reinterpret_cast<const char*>(piece.data.data()), piece.data.size());
      return;
    }
    Flush();
    using Owner = std::shared_ptr<const void>;
    slices_.emplace_back(
        const_cast<uint8_t*>(piece.data.data()), piece.data.size(),
        [](void* owner) { delete static_cast<Owner*>(owner); }, new Owner(piece.owner));
  }
  grpc::ByteBuffer Take() {
    Flush();
    return {slices_.data(), slices_.size()};
  }

 private:
  void Flush() {
    if (text.empty()) return;
    slices_.emplace_back(text);
    text.clear();
  }

  std::vector<grpc::Slice> slices_;
};

}  // namespace

grpc::ByteBuffer RepliesInOne(std::span<const grpc::ByteBuffer* const> messages) {
  std::vector<grpc::Slice> all, one;
  for (const grpc::ByteBuffer* message : messages) {  // elements of a repeated field follow one another
    message->Dump(&one);
    std::move(one.begin(), one.end(), std::back_inserter(all));
  }
  return {all.data(), all.size()};
}

std::string ResponseCoder::Envelope(uint64_t response_bytes) const {
  std::string out;
  if (!job_id_) return out;
  PutLength(v1::VoxelizeBatchResponse::kRepliesFieldNumber, 1 + VarintSize(*job_id_) + FieldSize(response_bytes), out);
  PutKey(v1::BatchReply::kIdFieldNumber, kVarint, out);
  PutVarint(*job_id_, out);
  PutLength(v1::BatchReply::kResponseFieldNumber, response_bytes, out);
  return out;
}

grpc::ByteBuffer ResponseCoder::Message(const v1::VoxelizeResponse& response) const {
  std::string text = Envelope(response.ByteSizeLong());
  response.AppendToString(&text);
  const grpc::Slice slice(text);
  return {&slice, 1};
}

grpc::ByteBuffer ResponseCoder::Piece(const CodedPiece& piece) const {
  const std::string head = PieceHead(piece);
  const uint64_t piece_bytes = head.size() + piece.data.size();
  Slices slices;
  slices.text = Envelope(FieldSize(piece_bytes));
  PutLength(v1::VoxelizeResponse::kPiecesFieldNumber, piece_bytes, slices.text);
  slices.text += head;
  slices.Add(piece);
  return slices.Take();
}

grpc::ByteBuffer ResponseCoder::Whole(const v1::VoxelizeResponse& head, std::span<const CodedPiece> pieces) const {
  std::vector<std::string> heads;
  const size_t head_bytes = head.ByteSizeLong();
  uint64_t bytes = head_bytes;
  for (const CodedPiece& piece : pieces) {
    heads.push_back(PieceHead(piece));
    bytes += FieldSize(heads.back().size() + piece.data.size());
  }
  Slices slices;
  slices.text = Envelope(bytes);
  slices.text.reserve(slices.text.size() + size_t(bytes < kCopyBelow ? bytes : head_bytes));
  const size_t begin = slices.text.size();
  slices.text.resize(begin + head_bytes);
  head.SerializeWithCachedSizesToArray(reinterpret_cast<uint8_t*>(slices.text.data() + begin));
  for (size_t i = 0; i < pieces.size(); ++i) {
    PutLength(v1::VoxelizeResponse::kPiecesFieldNumber, heads[i].size() + pieces[i].data.size(), slices.text);
    slices.text += heads[i];
    slices.Add(pieces[i]);
  }
  return slices.Take();
}

}  // namespace voxelpipe
