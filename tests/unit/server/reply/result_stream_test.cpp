#include "reply/result_stream.h"

#include <zstd.h>

#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <grpcpp/impl/codegen/proto_utils.h>

#include "base/checksum/crc32c.h"
#include "gtest/gtest.h"
#include "state/service_state.h"
#include "wire/duration.h"
#include "wire/request.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kPieceBytes = 1 << 20;
const VoxelizeRequest kRequest;  // for the header

// A result with one target of each size, filled with bytes that differ.
JobOutcome MakeOutcome(const std::vector<uint64_t>& sizes) {
  JobOutcome outcome;
  outcome.result.specs.assign(sizes.size(), TargetSpec());
  uint32_t seed = 1;
  for (const uint64_t size : sizes) {
    HostBuffer buffer = *HostBuffer::Allocate(size);
    for (uint8_t& byte : buffer.bytes()) byte = uint8_t((seed = seed * 1664525 + 1013904223) >> 24);
    outcome.result.targets.push_back(std::move(buffer));
  }
  return outcome;
}

std::shared_ptr<const JobOutcome> Shared(JobOutcome outcome) {
  return std::make_shared<const JobOutcome>(std::move(outcome));
}

std::string Text(std::span<const uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::span<const uint8_t> Bytes(const std::string& text) {
  return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}

// What a client reads.
template <typename Message = v1::VoxelizeResponse>
Message Received(grpc::ByteBuffer buffer) {
  Message message;
  EXPECT_TRUE(grpc::SerializationTraits<Message>::Deserialize(&buffer, &message).ok());
  return message;
}

// Reads a stream to its end. Out: the bytes of each target.
struct ReadResult {
  std::vector<std::string> targets;
  std::vector<v1::ResultPiece> pieces;
  v1::Summary summary;
};
ReadResult ReadAll(ResultStream& stream, size_t targets) {
  ReadResult read;
  read.targets.resize(targets);
  EXPECT_TRUE(Received(stream.Next()).has_header());
  while (!stream.done()) {
    const v1::VoxelizeResponse response = Received(stream.Next());
    stream.CatchUp();
    if (response.has_summary()) read.summary = response.summary();
    if (response.pieces().empty()) continue;
    EXPECT_EQ(response.pieces_size(), 1);
    const v1::ResultPiece& piece = response.pieces(0);
    EXPECT_LT(size_t(piece.array()), targets);
    if (size_t(piece.array()) >= targets) break;
    EXPECT_EQ(piece.crc32c(), Crc32c(Bytes(piece.data())));
    std::string& target = read.targets[size_t(piece.array())];
    EXPECT_EQ(piece.offset(), int64_t(target.size()));
    if (!piece.has_uncompressed_bytes()) {
      target += piece.data();
    } else {
      std::string raw(size_t(piece.uncompressed_bytes()), '\0');
      EXPECT_EQ(ZSTD_decompress(raw.data(), raw.size(), piece.data().data(), piece.data().size()), raw.size());
      target += raw;
    }
    read.pieces.push_back(piece);
  }
  return read;
}

TEST(ResultStreamTest, SendsHeaderThenEveryByteInOrderThenSummary) {
  const std::vector<uint64_t> sizes = {1, kPieceBytes - 1, 0, kPieceBytes, 2 * kPieceBytes + 1};
  const auto outcome = Shared(MakeOutcome(sizes));
  Sha256 hash;
  for (const HostBuffer& target : outcome->result.targets) hash.Update(target.bytes());
  ResultStream stream(outcome, kRequest, {}, {.piece_bytes = kPieceBytes});
  const ReadResult read = ReadAll(stream, sizes.size());
  EXPECT_EQ(read.pieces.size(), 1u + 1 + 0 + 1 + 3);
  for (size_t t = 0; t < sizes.size(); ++t) EXPECT_EQ(read.targets[t], Text(outcome->result.targets[t].bytes())) << t;
  for (const v1::ResultPiece& piece : read.pieces) EXPECT_LE(piece.data().size(), kPieceBytes);
  EXPECT_EQ(stream.bytes(), 4 * kPieceBytes + 1);
  EXPECT_EQ(stream.sent_bytes(), stream.bytes());
  EXPECT_EQ(read.summary.content_sha256(), hash.HexDigest());
  EXPECT_EQ(read.summary.result_bytes(), int64_t(stream.bytes()));
  EXPECT_EQ(read.summary.sent_bytes(), int64_t(stream.bytes()));
}

TEST(ResultStreamTest, LargePiecesAreNotCopiedAndKeepTheResult) {
  std::shared_ptr<const JobOutcome> outcome = Shared(MakeOutcome({kPieceBytes}));
  const std::weak_ptr<const JobOutcome> alive = outcome;
  const uint8_t* const begin = outcome->result.targets[0].data();
  const std::string expected = Text(outcome->result.targets[0].bytes());
  auto stream = std::make_unique<ResultStream>(std::move(outcome), kRequest, CallSettings(), PieceOptions());
  stream->Next();
  grpc::ByteBuffer message = stream->Next();
  {
    std::vector<grpc::Slice> slices;
    ASSERT_TRUE(message.Dump(&slices).ok());
    ASSERT_EQ(slices.size(), 2u);
    EXPECT_EQ(slices[1].begin(), begin);
  }
  stream.reset();
  EXPECT_FALSE(alive.expired()) << "gRPC may still send from it";
  EXPECT_EQ(Received(message).pieces(0).data(), expected);
  message.Clear();
  EXPECT_TRUE(alive.expired()) << "who drops the message frees the result";
}

TEST(ResultStreamTest, CompressesWhereThatIsSmaller) {
  JobOutcome noise_and_zeros = MakeOutcome({kPieceBytes, 3 * kPieceBytes});
  std::memset(noise_and_zeros.result.targets[1].data(), 0, 3 * kPieceBytes);
  const auto outcome = Shared(std::move(noise_and_zeros));
  Sha256 hash;
  for (const HostBuffer& target : outcome->result.targets) hash.Update(target.bytes());
  CallSettings settings;
  settings.compression = Compression::kZstd;
  ResultStream stream(outcome, kRequest, settings, {.piece_bytes = kPieceBytes});
  const ReadResult read = ReadAll(stream, 2);
  ASSERT_EQ(read.pieces.size(), 4u);
  EXPECT_FALSE(read.pieces[0].has_uncompressed_bytes()) << "noise does not become smaller";
  EXPECT_EQ(read.pieces[1].uncompressed_bytes(), int64_t(kPieceBytes));
  for (size_t t = 0; t < 2; ++t) EXPECT_EQ(read.targets[t], Text(outcome->result.targets[t].bytes())) << t;
  EXPECT_EQ(read.summary.content_sha256(), hash.HexDigest()) << "of the bytes before compression";
  EXPECT_EQ(read.summary.result_bytes(), int64_t(4 * kPieceBytes));
  EXPECT_EQ(read.summary.sent_bytes(), int64_t(stream.sent_bytes()));
  EXPECT_LT(stream.sent_bytes(), kPieceBytes + 10'000);
}

TEST(ResultStreamTest, ChecksumsOfAResultForManyAreComputedOnce) {
  JobOutcome made = MakeOutcome({kPieceBytes + 7, 5});
  made.sums = std::make_shared<ResultSums>(made.result, kPieceBytes);
  uint8_t* const bytes = made.result.targets[0].data();
  const auto outcome = Shared(std::move(made));
  Sha256 hash;
  for (const HostBuffer& target : outcome->result.targets) hash.Update(target.bytes());
  const std::string digits = hash.HexDigest();
  ResultStream first(outcome, kRequest, {}, {.piece_bytes = kPieceBytes});
  const ReadResult read = ReadAll(first, 2);
  EXPECT_EQ(read.summary.content_sha256(), digits);
  EXPECT_EQ(outcome->sums->sha256(), digits) << "for those who come later";
  // Data that is not read again may change unnoticed.
  bytes[0] ^= 1;
  ResultStream second(outcome, kRequest, {}, {.piece_bytes = kPieceBytes});
  EXPECT_TRUE(Received(second.Next()).has_header());
  for (const v1::ResultPiece& piece : read.pieces)
    EXPECT_EQ(Received(second.Next()).pieces(0).crc32c(), piece.crc32c()) << piece.offset();
  EXPECT_EQ(Received(second.Next()).summary().content_sha256(), digits);
}

TEST(ResultStreamTest, SumsOfOtherPiecesOrCompressedOnesAreTheirOwn) {
  JobOutcome made = MakeOutcome({3 * kPieceBytes});
  std::memset(made.result.targets[0].data(), 0, 2 * kPieceBytes);
  made.sums = std::make_shared<ResultSums>(made.result, kPieceBytes);
  const auto outcome = Shared(std::move(made));
  for (const Compression compression : {Compression::kNone, Compression::kZstd, Compression::kNone}) {
    for (const uint64_t piece_bytes : {kPieceBytes, kPieceBytes / 2, 2 * kPieceBytes}) {
      CallSettings settings;
      settings.compression = compression;
      ResultStream stream(outcome, kRequest, settings, {.piece_bytes = piece_bytes});
      EXPECT_EQ(ReadAll(stream, 1).targets[0], Text(outcome->result.targets[0].bytes()));  // checks each CRC
    }
  }
}

TEST(ResultStreamTest, TellsWhenTheNextMessageFollowsAtOnce) {
  JobOutcome made = MakeOutcome({3 * kPieceBytes});
  made.sums = std::make_shared<ResultSums>(made.result, kPieceBytes);
  const auto outcome = Shared(std::move(made));
  const auto all_ready = [&](const CallSettings& settings) {
    ResultStream stream(outcome, kRequest, settings, {.piece_bytes = kPieceBytes});
    bool ready = true;
    while (!stream.done()) {
      ready = ready && stream.next_is_ready();
      stream.Next();
      stream.CatchUp();
    }
    EXPECT_FALSE(stream.next_is_ready()) << "there is none";
    return ready;
  };
  CallSettings plain, compressed;
  plain.content_hash = compressed.content_hash = false;
  compressed.compression = Compression::kZstd;
  EXPECT_TRUE(all_ready(plain));
  EXPECT_FALSE(all_ready(compressed));
  EXPECT_FALSE(all_ready({})) << "hashed between two pieces";
  EXPECT_TRUE(all_ready({})) << "the hash is known by now";
}

TEST(ResultStreamTest, WithoutHashThereIsNone) {
  CallSettings settings;
  settings.content_hash = false;
  ResultStream stream(Shared(MakeOutcome({5})), kRequest, settings, {});
  EXPECT_EQ(ReadAll(stream, 1).summary.content_sha256(), "");
}

TEST(ResultStreamTest, PartsOfAJobCarryItsId) {
  const auto outcome = Shared(MakeOutcome({40'000}));
  ResultStream stream(outcome, kRequest, {}, {}, ResponseCoder(777));
  std::vector<v1::VoxelizeResponse> parts;
  while (!stream.done()) {
    const auto message = Received<v1::VoxelizeBatchResponse>(stream.Next());
    stream.CatchUp();
    ASSERT_EQ(message.replies_size(), 1);
    EXPECT_EQ(message.replies(0).id(), 777u);
    ASSERT_TRUE(message.replies(0).has_response());
    parts.push_back(message.replies(0).response());
  }
  ASSERT_EQ(parts.size(), 3u);
  EXPECT_TRUE(parts[0].has_header());
  ASSERT_EQ(parts[1].pieces_size(), 1);
  EXPECT_EQ(parts[1].pieces(0).data(), Text(outcome->result.targets[0].bytes()));
  EXPECT_TRUE(parts[2].has_summary());
}

// An id of 0 is one like any other.
TEST(ResponseCoderTest, MessagesOfJobsBecomeOneWithTheRepliesOfAll) {
  const auto outcome = Shared(MakeOutcome({100, 200'000}));
  std::vector<grpc::ByteBuffer> messages;
  for (const uint64_t id : {uint64_t{5}, uint64_t{0}, std::numeric_limits<uint64_t>::max()}) {
    ResultPieces pieces(kRequest, {}, {}, ResponseCoder(id));
    messages.push_back(pieces.Whole(nullptr, outcome));
  }
  v1::VoxelizeResponse progress;
  progress.mutable_progress()->set_stage("load");
  messages.push_back(ResponseCoder(7).Message(progress));
  std::vector<const grpc::ByteBuffer*> all;
  for (const grpc::ByteBuffer& message : messages) all.push_back(&message);
  for (size_t count = 1; count <= all.size(); ++count) {
    const auto response = Received<v1::VoxelizeBatchResponse>(RepliesInOne(std::span(all).first(count)));
    ASSERT_EQ(size_t(response.replies_size()), count);
    for (size_t i = 0; i < count; ++i) {
      const auto alone = Received<v1::VoxelizeBatchResponse>(messages[i]);
      EXPECT_EQ(response.replies(int(i)).SerializeAsString(), alone.replies(0).SerializeAsString()) << i;
    }
    EXPECT_EQ(response.replies(0).id(), 5u);
  }
}

TEST(ResultPiecesTest, AWholeResultIsOneMessage) {
  // One that is copied, one that is referred to, one that is empty.
  const auto outcome = Shared(MakeOutcome({100, 200'000, 0}));
  Plan plan;
  plan.backend = "cpu";
  enum class Way { kCall, kBatch };
  for (const Way way : {Way::kCall, Way::kBatch}) {
    ResultPieces pieces(kRequest, {}, {}, way == Way::kBatch ? ResponseCoder(5) : ResponseCoder());
    grpc::ByteBuffer message = pieces.Whole(&plan, outcome);
    v1::VoxelizeResponse whole;
    if (way == Way::kBatch) {
      const auto response = Received<v1::VoxelizeBatchResponse>(std::move(message));
      ASSERT_EQ(response.replies_size(), 1);
      EXPECT_EQ(response.replies(0).id(), 5u);
      whole = response.replies(0).response();
    } else {
      whole = Received(std::move(message));
    }
    EXPECT_EQ(whole.plan().backend(), v1::BACKEND_CPU);
    EXPECT_EQ(whole.header().arrays_size(), 3);
    EXPECT_EQ(whole.header().spec().SerializeAsString(), MakeSpec(kRequest).SerializeAsString());
    ASSERT_EQ(whole.pieces_size(), 2);
    Sha256 hash;
    for (int i = 0; i < 2; ++i) {
      EXPECT_EQ(whole.pieces(i).array(), i);
      EXPECT_EQ(whole.pieces(i).data(), Text(outcome->result.targets[size_t(i)].bytes()));
      EXPECT_EQ(whole.pieces(i).crc32c(), Crc32c(Bytes(whole.pieces(i).data())));
      hash.Update(Bytes(whole.pieces(i).data()));
    }
    EXPECT_EQ(whole.summary().content_sha256(), hash.HexDigest());
    EXPECT_EQ(whole.summary().result_bytes(), 200'100);
  }
}

TEST(ResultPiecesTest, OneMessageIsForResultsThatAreSmallEnough) {
  const auto fits = [](uint64_t bytes, std::optional<int64_t> limit) {
    CallSettings settings;
    settings.single_message_bytes = limit;
    return FitsOneMessage(bytes, settings);
  };
  EXPECT_TRUE(fits(1 << 20, std::nullopt));
  EXPECT_FALSE(fits((1 << 20) + 1, std::nullopt));
  EXPECT_TRUE(fits(100, 100));
  EXPECT_FALSE(fits(101, 100));
  EXPECT_TRUE(fits(1 << 20, std::numeric_limits<int64_t>::max()));
  EXPECT_FALSE(fits((1 << 20) + 1, std::numeric_limits<int64_t>::max())) << "the server has its own maximum";
  EXPECT_FALSE(fits(1, 0));
  EXPECT_FALSE(fits(0, 0)) << "never";
  EXPECT_TRUE(fits(0, 1));
}

TEST(ResultStreamTest, TheHashIsThatOfTheStandard) {
  Sha256 hash;
  const std::string text = "abc";
  hash.Update(Bytes(text).first(1));
  hash.Update(Bytes(text).subspan(1));
  EXPECT_EQ(hash.HexDigest(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(ResultStreamTest, TheSummaryTellsWhatIsKnown) {
  JobOutcome outcome = MakeOutcome({3});
  outcome.result.stats.occupied = 17;
  outcome.result.stats.stages = {{"load", 1}, {"flatten", 2}};
  outcome.report.open_edges = 4;
  outcome.examined = true;
  outcome.peak_bytes = 99;
  outcome.queue_ms = 1.5;
  for (int i = 0; i < 1000; ++i) {
    outcome.result.stats.warnings.Add(WarningCode::kCountMismatch, "node " + std::to_string(i), "'\xff' is odd");
  }
  ResultStream stream(Shared(std::move(outcome)), kRequest, {}, {});
  const v1::Summary summary = ReadAll(stream, 1).summary;
  EXPECT_EQ(summary.stats().occupied(), 17);
  ASSERT_EQ(summary.stats().stages_size(), 2);
  EXPECT_EQ(summary.stats().stages(1).stage(), "flatten");
  EXPECT_EQ(MsOf(summary.stats().stages(1).time()), 2);
  EXPECT_EQ(MsOf(summary.stats().queue_time()), 1.5);
  EXPECT_EQ(summary.report().open_edges(), 4);
  EXPECT_EQ(summary.peak_bytes(), 99);
  EXPECT_EQ(summary.warnings_size(), 100) << "a stranger's file must not make the summary large";
  EXPECT_EQ(summary.warnings_left_out(), 900);
  EXPECT_EQ(summary.warnings(1).code(), v1::WARNING_CODE_COUNT_MISMATCH);
  EXPECT_EQ(summary.warnings(1).place(), "node 1");
  EXPECT_EQ(summary.warnings(1).text(), "'?' is odd");
}

}  // namespace
}  // namespace voxelpipe
