// The client's checks of a server's response.
#include "result_reader.h"

#include <zstd.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include <grpcpp/support/slice.h>

#include "base/checksum/crc32c.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "job/memory_sink.h"
#include "wire/duration.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

// SHA-256 of 16 bytes 0x00, 0x01 ... 0x0f.
constexpr char kSha256[] = "be45cb2605bf36bebde684841a28f0fd43c69850a3dce5fedba69928ee3a8991";

// A planar pair of targets over 2x2x1 voxels would do as well; one f32 target over 4 voxels is the smallest that has
// pieces.
VoxelizeRequest FourFloats() {
  VoxelizeRequest request;
  request.grid.dims = {4, 1, 1};
  request.grid.origin = Vec3d{0, 0, 0};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  request.targets[0].format = VoxelFormat::kF32;
  request.targets[0].blend = Blend::kReplace;
  return request;
}

v1::ResultHeader Header(const VoxelizeRequest& request) {
  GridSpec grid;
  grid.dims = {4, 1, 1};
  return ToMessage(DenseHeader(request, grid), request);
}

// Messages of one part each.
v1::VoxelizeResponse Message(const v1::ResultHeader& header) {
  v1::VoxelizeResponse message;
  *message.mutable_header() = header;
  return message;
}
v1::VoxelizeResponse Message(const v1::ResultPiece& piece) {
  v1::VoxelizeResponse message;
  *message.add_pieces() = piece;
  return message;
}
v1::VoxelizeResponse Message(const v1::Summary& summary) {
  v1::VoxelizeResponse message;
  *message.mutable_summary() = summary;
  return message;
}

// As it comes from gRPC, in slices of so many bytes.
grpc::ByteBuffer Buffer(const v1::VoxelizeResponse& message, size_t slice_bytes = SIZE_MAX) {
  const std::string text = message.SerializeAsString();
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < text.size(); at += std::min(slice_bytes, text.size())) {
    slices.emplace_back(text.substr(at, slice_bytes));
  }
  return {slices.data(), slices.size()};
}

v1::ResultPiece Piece(int64_t offset, size_t bytes) {
  v1::ResultPiece piece;
  piece.set_offset(offset);
  for (size_t i = 0; i < bytes; ++i) piece.mutable_data()->push_back(char(size_t(offset) + i));
  piece.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(piece.data().data()), bytes}));
  return piece;
}

v1::Summary GoodSummary() {
  v1::Summary summary;
  summary.set_content_sha256(kSha256);
  summary.set_peak_bytes(77);
  for (const char* stage : {"load", "flatten", "fine_raster"}) {
    v1::StageTime* time = summary.mutable_stats()->add_stages();
    time->set_stage(stage);
    WriteMs(3, *time->mutable_time());
  }
  return summary;
}

// A reader that has its header and the first of two pieces.
class ResultReaderTest : public ::testing::Test {
 protected:
  ResultReaderTest() {
    EXPECT_TRUE(reader_.Add(Message(Header(request_))).ok());
    EXPECT_TRUE(reader_.Add(Message(Piece(0, 6))).ok());
  }
  void ExpectLost(const absl::Status& status, const std::string& why) {
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(why));
  }

  VoxelizeRequest request_ = FourFloats();
  MemorySink sink_;
  ResultReader reader_{request_, 1 << 20, sink_};
};

TEST_F(ResultReaderTest, PutsPiecesTogether) {
  ASSERT_TRUE(reader_.Add(Message(Piece(6, 10))).ok());
  ASSERT_TRUE(reader_.Add(Message(GoodSummary())).ok());
  const absl::StatusOr<RemoteRun> run = reader_.Take();
  ASSERT_TRUE(run.ok()) << run.status();
  const VoxelizeResult result = sink_.Take();
  ASSERT_EQ(result.targets.size(), 1u);
  for (size_t i = 0; i < 16; ++i) EXPECT_EQ(result.targets[0].data()[i], i);
  EXPECT_EQ(run->content_sha256, kSha256);
  EXPECT_EQ(run->peak_bytes, 77u);
  ASSERT_EQ(run->mesh_stages.size(), 2u);
  EXPECT_EQ(run->mesh_stages[1].first, "flatten");
  ASSERT_EQ(run->stats.stages.size(), 1u);
  EXPECT_EQ(run->stats.stages[0].first, "fine_raster");
}

TEST_F(ResultReaderTest, RefusesAFlippedBit) {
  v1::ResultPiece piece = Piece(6, 10);
  (*piece.mutable_data())[3] ^= 1;
  ExpectLost(reader_.Add(Message(piece)), "CRC32C of the piece at offset 6");
}

TEST_F(ResultReaderTest, RefusesGapsOverlapsAndOtherTargets) {
  ExpectLost(reader_.Add(Message(Piece(7, 9))), "offset 7");
  ExpectLost(reader_.Add(Message(Piece(0, 6))), "offset 0");
  v1::ResultPiece other = Piece(6, 10);
  other.set_array(1);
  ExpectLost(reader_.Add(Message(other)), "array 1");
}

TEST_F(ResultReaderTest, RefusesMoreBytesThanAnnounced) {
  ExpectLost(reader_.Add(Message(Piece(6, 11))), "11 bytes");
  ASSERT_TRUE(reader_.Add(Message(Piece(6, 10))).ok());
  ExpectLost(reader_.Add(Message(Piece(16, 1))), "more bytes");
}

TEST_F(ResultReaderTest, RefusesAnEmptyPiece) {
  ExpectLost(reader_.Add(Message(Piece(6, 0))), "without bytes");
}

TEST_F(ResultReaderTest, RefusesASummaryTooEarly) {
  ExpectLost(reader_.Add(Message(GoodSummary())), "6 of 16 bytes");
}

TEST_F(ResultReaderTest, RefusesAnotherSha256) {
  ASSERT_TRUE(reader_.Add(Message(Piece(6, 10))).ok());
  v1::Summary summary = GoodSummary();
  summary.mutable_content_sha256()->front() = '0';
  ExpectLost(reader_.Add(Message(summary)), "SHA-256");
}

TEST_F(ResultReaderTest, RefusesToEndWithoutASummary) {
  ExpectLost(reader_.Take().status(), "before its summary");
}

// The ten bytes from offset 6 as one frame.
v1::ResultPiece Compressed() {
  v1::ResultPiece piece = Piece(6, 10);
  const std::string raw = piece.data();
  std::string frame(ZSTD_compressBound(raw.size()), '\0');
  frame.resize(ZSTD_compress(frame.data(), frame.size(), raw.data(), raw.size(), 1));
  piece.set_data(frame);
  piece.set_uncompressed_bytes(int64_t(raw.size()));
  piece.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(frame.data()), frame.size()}));
  return piece;
}

TEST_F(ResultReaderTest, TakesCompressedPieces) {
  ASSERT_TRUE(reader_.Add(Message(Compressed())).ok());
  ASSERT_TRUE(reader_.Add(Message(GoodSummary())).ok()) << "the SHA-256 is that of the bytes before compression";
  EXPECT_EQ(reader_.Take()->sent_bytes, 6 + Compressed().data().size());
}

TEST_F(ResultReaderTest, BelievesNoSizeOfACompressedPiece) {
  v1::ResultPiece piece = Compressed();
  piece.set_uncompressed_bytes(9);
  ExpectLost(reader_.Add(Message(piece)), "announced size");
  piece.set_uncompressed_bytes(11);
  ExpectLost(reader_.Add(Message(piece)), "11 bytes");
  piece.set_uncompressed_bytes(int64_t{1} << 60);
  ExpectLost(reader_.Add(Message(piece)), "bytes at offset 6");
}

// As messages come from gRPC: in slices that end anywhere.
TEST_F(ResultReaderTest, TakesPiecesInParts) {
  for (const v1::ResultPiece& piece : {Piece(6, 10), Compressed()}) {
    for (const size_t slice_bytes : {1, 5, 1000}) {
      MemorySink sink;
      ResultReader reader(request_, 1 << 20, sink);
      v1::VoxelizeResponse pieces = Message(Piece(0, 6));
      *pieces.add_pieces() = piece;
      for (const v1::VoxelizeResponse& message : {Message(Header(request_)), pieces, Message(GoodSummary())}) {
        grpc::ByteBuffer buffer = Buffer(message, slice_bytes);
        ASSERT_TRUE(reader.Add(buffer).ok());
      }
      EXPECT_EQ(reader.Take()->sent_bytes, 6 + piece.data().size());
      const VoxelizeResult result = sink.Take();
      for (size_t i = 0; i < 16; ++i) EXPECT_EQ(result.targets[0].data()[i], i);
    }
  }
}

// The form of a small result, after the messages that may come before it.
TEST(ResultReaderHeaderTest, TakesAllPartsInOneMessage) {
  const VoxelizeRequest request = FourFloats();
  for (const bool parsed : {false, true}) {
    std::vector<std::string> told;
    MemorySink sink;
    ResultReader reader(request, 1 << 20, sink, /*hashed=*/true,
                        {[&](const Plan& plan) { told.push_back("plan " + std::to_string(plan.result_bytes)); },
                         [&](const std::string& stage, double) { told.push_back(stage); }});
    v1::VoxelizeResponse all = Message(Header(request));
    *all.mutable_plan()->mutable_grid() = all.header().grid();
    all.mutable_plan()->set_result_bytes(16);
    all.mutable_progress()->set_stage("fill");
    *all.add_pieces() = Piece(0, 6);
    *all.add_pieces() = Piece(6, 10);
    *all.mutable_summary() = GoodSummary();
    grpc::ByteBuffer buffer = Buffer(all);
    const absl::Status status = parsed ? reader.Add(all) : reader.Add(buffer);
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_EQ(reader.Take()->content_sha256, kSha256);
    EXPECT_EQ(told, (std::vector<std::string>{"plan 16", "fill", "download"}));
  }
}

TEST_F(ResultReaderTest, SkipsMessagesOfANewerServer) {
  EXPECT_TRUE(reader_.Add(v1::VoxelizeResponse()).ok());
  ASSERT_TRUE(reader_.Add(Message(Piece(6, 10))).ok());
  ASSERT_TRUE(reader_.Add(Message(GoodSummary())).ok());
}

TEST_F(ResultReaderTest, RefusesAMessageThatCannotBeRead) {
  const grpc::Slice slice("\xff\xff\xff");
  grpc::ByteBuffer buffer(&slice, 1);
  ExpectLost(reader_.Add(buffer), "cannot be read");
}

TEST_F(ResultReaderTest, RefusesWhatFollowsTheSummary) {
  ASSERT_TRUE(reader_.Add(Message(Piece(6, 10))).ok());
  ASSERT_TRUE(reader_.Add(Message(GoodSummary())).ok());
  ExpectLost(reader_.Add(Message(Piece(16, 1))), "a piece after the summary");
  ExpectLost(reader_.Add(Message(GoodSummary())), "a second summary");
  ExpectLost(reader_.Add(Message(Header(request_))), "a second header");
  v1::VoxelizeResponse progress;
  progress.mutable_progress();
  ExpectLost(reader_.Add(progress), "progress after the summary");
}

TEST_F(ResultReaderTest, RefusesNegativeNumbersOfAPiece) {
  v1::ResultPiece piece = Piece(6, 10);
  piece.set_array(-1);
  ExpectLost(reader_.Add(Message(piece)), "array -1");
  piece = Piece(6, 10);
  piece.set_offset(-6);
  ExpectLost(reader_.Add(Message(piece)), "offset -6");
  for (const int64_t bytes : {int64_t{0}, int64_t{-1}, INT64_MIN}) {
    piece = Compressed();
    piece.set_uncompressed_bytes(bytes);
    ExpectLost(reader_.Add(Message(piece)), std::to_string(bytes) + " bytes at offset 6");
  }
}

// They are reported, no memory is sized by them.
TEST_F(ResultReaderTest, TakesNegativeStatisticsForZero) {
  ASSERT_TRUE(reader_.Add(Message(Piece(6, 10))).ok());
  v1::Summary summary = GoodSummary();
  summary.set_peak_bytes(-1);
  summary.mutable_stats()->set_triangles(INT64_MIN);
  summary.mutable_stats()->set_attempts(-3);
  ASSERT_TRUE(reader_.Add(Message(summary)).ok());
  const absl::StatusOr<RemoteRun> run = reader_.Take();
  EXPECT_EQ(run->peak_bytes, 0u);
  EXPECT_EQ(run->stats.triangles, 0u);
  EXPECT_EQ(run->served.attempts, 0u);
}

TEST(ResultReaderHeaderTest, RefusesLiesAboutPlanAndProgress) {
  const VoxelizeRequest request = FourFloats();
  const auto error = [&](const std::vector<v1::VoxelizeResponse>& messages) {
    MemorySink sink;
    ResultReader reader(request, 1 << 20, sink);
    absl::Status status;
    for (const v1::VoxelizeResponse& message : messages) {
      EXPECT_TRUE(status.ok()) << "only the last message is a lie";
      status = reader.Add(message);
    }
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
    return std::string(status.message());
  };
  v1::VoxelizeResponse plan, no_grid, no_number;
  *plan.mutable_plan()->mutable_grid() = Header(request).grid();
  no_grid.mutable_plan();
  no_number.mutable_progress()->set_fraction(std::nan(""));
  EXPECT_THAT(error({plan, plan}), HasSubstr("a second plan"));
  EXPECT_THAT(error({Message(Header(request)), plan}), HasSubstr("a plan after the header"));
  EXPECT_THAT(error({no_grid}), HasSubstr("a grid"));
  EXPECT_THAT(error({no_number}), HasSubstr("no number"));
}

// A sink may act on what it gets: not a byte of a broken piece.
TEST(ResultReaderHeaderTest, TheSinkGetsNothingOfABrokenPiece) {
  struct Counting : ResultSink {
    absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
    absl::Status Write(size_t, std::span<const uint8_t> part) override {
      bytes += part.size();
      return absl::OkStatus();
    }
    size_t bytes = 0;
  };
  const VoxelizeRequest request = FourFloats();
  Counting sink;
  ResultReader reader(request, 1 << 20, sink);
  ASSERT_TRUE(reader.Add(Message(Header(request))).ok());
  v1::ResultPiece piece = Piece(0, 16);
  piece.mutable_data()->back() ^= 1;
  grpc::ByteBuffer buffer = Buffer(Message(piece), 12);
  EXPECT_EQ(reader.Add(buffer).code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(sink.bytes, 0u);
}

TEST_F(ResultReaderTest, RefusesABrokenFrame) {
  v1::ResultPiece piece = Compressed();
  piece.mutable_data()->resize(piece.data().size() - 1);
  piece.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(piece.data().data()), piece.data().size()}));
  ExpectLost(reader_.Add(Message(piece)), "zstd frame");
}

TEST(ResultReaderHeaderTest, DoesWithoutAHashWhereNoneWasAskedFor) {
  const VoxelizeRequest request = FourFloats();
  MemorySink sink;
  ResultReader reader(request, 1 << 20, sink, /*hashed=*/false);
  v1::VoxelizeResponse all = Message(Header(request));
  *all.add_pieces() = Piece(0, 16);
  *all.mutable_summary() = GoodSummary();
  all.mutable_summary()->clear_content_sha256();
  ASSERT_TRUE(reader.Add(all).ok());
  EXPECT_EQ(reader.Take()->content_sha256, "");
}

TEST_F(ResultReaderTest, RefusesASecondHeader) {
  ExpectLost(reader_.Add(Message(Header(request_))), "second header");
}

// Where the sink says no, the call is to end with what it says.
TEST(ResultReaderHeaderTest, TheSinksErrorsArePassedOn) {
  struct Full : ResultSink {
    absl::Status Begin(const ResultHeader&) override { return absl::OkStatus(); }
    absl::Status Write(size_t, std::span<const uint8_t>) override { return absl::UnavailableError("the disk is full"); }
  };
  const VoxelizeRequest request = FourFloats();
  Full sink;
  ResultReader reader(request, 1 << 20, sink);
  ASSERT_TRUE(reader.Add(Message(Header(request))).ok());
  EXPECT_EQ(reader.Add(Message(Piece(0, 6))), absl::UnavailableError("the disk is full"));
}

TEST(ResultReaderHeaderTest, RefusesPiecesBeforeTheHeader) {
  const VoxelizeRequest request = FourFloats();
  MemorySink sink;
  ResultReader reader(request, 1 << 20, sink);
  EXPECT_EQ(reader.Add(Message(Piece(0, 16))).code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(reader.Add(Message(GoodSummary())).code(), absl::StatusCode::kDataLoss);
}

// Nothing of these is ever allocated.
TEST(ResultReaderHeaderTest, RefusesWhatWasNotAskedFor) {
  const auto refused = [](const std::function<void(VoxelizeRequest&, v1::ResultHeader&)>& change,
                          uint64_t limit = 1 << 20) {
    VoxelizeRequest request = FourFloats();
    v1::ResultHeader header = Header(request);
    change(request, header);
    MemorySink sink;
    ResultReader reader(request, limit, sink);
    return reader.Add(Message(header)).code() == absl::StatusCode::kDataLoss;
  };
  const auto grow = [](v1::ResultHeader& header, int64_t x) {
    header.mutable_grid()->mutable_dims()->set_x(x);
    header.mutable_arrays(0)->set_shape(2, x);
  };
  EXPECT_FALSE(refused([](auto&, auto&) {}));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.mutable_arrays(0)->set_shape(2, 5); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.mutable_arrays(0)->add_shape(2); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { *h.add_arrays() = h.arrays(0); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.clear_arrays(); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.clear_grid(); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.mutable_spec()->set_layout(v1::LAYOUT_PLANAR); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.mutable_spec()->set_result(v1::RESULT_KIND_SPARSE); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.clear_spec(); }));
  EXPECT_TRUE(refused([&](auto&, auto& h) { grow(h, 5); })) << "dims were given";
  EXPECT_TRUE(refused([&](auto&, auto& h) { grow(h, int64_t{1} << 62); }));
  EXPECT_TRUE(refused([&](auto&, auto& h) { grow(h, -4); }));
  EXPECT_TRUE(refused([](auto& r, auto&) { r.grid.voxel_size = Vec3d{2, 1, 1}; }));
  EXPECT_TRUE(refused([](auto&, auto&) {}, 15)) << "the client's own limit";
  const auto by_resolution = [](int64_t resolution) {
    return [resolution](VoxelizeRequest& r, v1::ResultHeader&) {
      r.grid = GridRequest();
      r.grid.resolution = resolution;
    };
  };
  EXPECT_FALSE(refused(by_resolution(4)));
  EXPECT_TRUE(refused(by_resolution(3)));
}

// Lists size the client's memory by the header alone.
TEST(ResultReaderHeaderTest, RefusesNegativeSizesOfLists) {
  for (const ResultKind kind : {ResultKind::kSparse, ResultKind::kBuckets}) {
    VoxelizeRequest request = FourFloats();
    request.result = kind;
    GridSpec grid;
    grid.dims = {4, 1, 1};
    const v1::ResultHeader honest = ToMessage(MakeResultHeader(request, grid, 1, 4, 4), request);
    for (int i = -1; i < honest.arrays_size(); ++i) {
      v1::ResultHeader header = honest;
      if (i >= 0) header.mutable_arrays(i)->set_shape(0, -1);
      MemorySink sink;
      ResultReader reader(request, 1 << 20, sink);
      EXPECT_EQ(reader.Add(Message(header)).code(), i < 0 ? absl::StatusCode::kOk : absl::StatusCode::kDataLoss) << i;
    }
  }
}

}  // namespace
}  // namespace voxelpipe
