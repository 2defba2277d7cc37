// The client's checks of a server's response.
#include "result_reader.h"

#include <zstd.h>

#include <functional>
#include <string>

#include "base/checksum/crc32c.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "job/memory_sink.h"
#include "reply/piece_view.h"
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
  return ToMessage(DenseHeader(request, grid));
}

v1::ResultPiece Piece(uint64_t offset, size_t bytes) {
  v1::ResultPiece piece;
  piece.set_offset(offset);
  for (size_t i = 0; i < bytes; ++i) piece.mutable_data()->push_back(char(offset + i));
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
    time->set_milliseconds(3);
  }
  return summary;
}

// A reader that has its header and the first of two pieces.
class ResultReaderTest : public ::testing::Test {
 protected:
  ResultReaderTest() {
    EXPECT_TRUE(reader_.AddHeader(Header(request_)).ok());
    EXPECT_TRUE(reader_.AddPiece(Piece(0, 6)).ok());
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
  ASSERT_TRUE(reader_.AddPiece(Piece(6, 10)).ok());
  EXPECT_EQ(reader_.fraction(), 1);
  ASSERT_TRUE(reader_.AddSummary(GoodSummary()).ok());
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
  ExpectLost(reader_.AddPiece(piece), "CRC32C of the piece at offset 6");
}

TEST_F(ResultReaderTest, RefusesGapsOverlapsAndOtherTargets) {
  ExpectLost(reader_.AddPiece(Piece(7, 9)), "offset 7");
  ExpectLost(reader_.AddPiece(Piece(0, 6)), "offset 0");
  v1::ResultPiece other = Piece(6, 10);
  other.set_target(1);
  ExpectLost(reader_.AddPiece(other), "array 1");
}

TEST_F(ResultReaderTest, RefusesMoreBytesThanAnnounced) {
  ExpectLost(reader_.AddPiece(Piece(6, 11)), "11 bytes");
  ASSERT_TRUE(reader_.AddPiece(Piece(6, 10)).ok());
  ExpectLost(reader_.AddPiece(Piece(16, 1)), "more bytes");
}

TEST_F(ResultReaderTest, RefusesAnEmptyPiece) {
  ExpectLost(reader_.AddPiece(Piece(6, 0)), "without bytes");
}

TEST_F(ResultReaderTest, RefusesASummaryTooEarly) {
  ExpectLost(reader_.AddSummary(GoodSummary()), "6 of 16 bytes");
}

TEST_F(ResultReaderTest, RefusesAnotherSha256) {
  ASSERT_TRUE(reader_.AddPiece(Piece(6, 10)).ok());
  v1::Summary summary = GoodSummary();
  summary.mutable_content_sha256()->front() = '0';
  ExpectLost(reader_.AddSummary(summary), "SHA-256");
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
  piece.set_raw_bytes(raw.size());
  piece.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(frame.data()), frame.size()}));
  return piece;
}

TEST_F(ResultReaderTest, TakesCompressedPieces) {
  ASSERT_TRUE(reader_.AddPiece(Compressed()).ok());
  ASSERT_TRUE(reader_.AddSummary(GoodSummary()).ok()) << "the SHA-256 is that of the bytes before compression";
  EXPECT_EQ(reader_.Take()->sent_bytes, 6 + Compressed().data().size());
}

TEST_F(ResultReaderTest, BelievesNoSizeOfACompressedPiece) {
  v1::ResultPiece piece = Compressed();
  piece.set_raw_bytes(9);
  ExpectLost(reader_.AddPiece(piece), "announced size");
  piece.set_raw_bytes(11);
  ExpectLost(reader_.AddPiece(piece), "11 bytes");
  piece.set_raw_bytes(uint64_t{1} << 60);
  ExpectLost(reader_.AddPiece(piece), "bytes at offset 6");
}

// As pieces come from gRPC: in parts that end anywhere.
TEST_F(ResultReaderTest, TakesPiecesInParts) {
  for (v1::ResultPiece piece : {Piece(6, 10), Compressed()}) {
    MemorySink sink;
    ResultReader reader(request_, 1 << 20, sink);
    ASSERT_TRUE(reader.AddHeader(Header(request_)).ok());
    ASSERT_TRUE(reader.AddPiece(Piece(0, 6)).ok());
    PieceView view(piece);
    const std::span<const uint8_t> all = view.data.front();
    view.data = {all.first(1), all.subspan(1, 4), all.subspan(5)};
    ASSERT_TRUE(reader.AddPiece(view).ok());
    ASSERT_TRUE(reader.AddSummary(GoodSummary()).ok());
    EXPECT_EQ(reader.Take()->sent_bytes, 6 + piece.data().size());
    const VoxelizeResult result = sink.Take();
    for (size_t i = 0; i < 16; ++i) EXPECT_EQ(result.targets[0].data()[i], i);
  }
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
  ASSERT_TRUE(reader.AddHeader(Header(request)).ok());
  v1::ResultPiece piece = Piece(0, 16);
  piece.mutable_data()->back() ^= 1;
  PieceView view(piece);
  const std::span<const uint8_t> all = view.data.front();
  view.data = {all.first(8), all.subspan(8)};
  EXPECT_EQ(reader.AddPiece(view).code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(sink.bytes, 0u);
}

TEST_F(ResultReaderTest, RefusesABrokenFrame) {
  v1::ResultPiece piece = Compressed();
  piece.mutable_data()->resize(piece.data().size() - 1);
  piece.set_crc32c(Crc32c({reinterpret_cast<const uint8_t*>(piece.data().data()), piece.data().size()}));
  ExpectLost(reader_.AddPiece(piece), "zstd frame");
}

TEST(ResultReaderHeaderTest, DoesWithoutAHashWhereNoneWasAskedFor) {
  const VoxelizeRequest request = FourFloats();
  MemorySink sink;
  ResultReader reader(request, 1 << 20, sink, /*hashed=*/false);
  v1::WholeResult whole;
  *whole.mutable_header() = Header(request);
  *whole.add_pieces() = Piece(0, 16);
  *whole.mutable_summary() = GoodSummary();
  whole.mutable_summary()->clear_content_sha256();
  ASSERT_TRUE(reader.AddWhole(whole).ok());
  EXPECT_EQ(reader.Take()->content_sha256, "");
}

TEST_F(ResultReaderTest, RefusesASecondHeader) {
  ExpectLost(reader_.AddHeader(Header(request_)), "second header");
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
  ASSERT_TRUE(reader.AddHeader(Header(request)).ok());
  EXPECT_EQ(reader.AddPiece(Piece(0, 6)), absl::UnavailableError("the disk is full"));
}

TEST(ResultReaderHeaderTest, RefusesPiecesBeforeTheHeader) {
  const VoxelizeRequest request = FourFloats();
  MemorySink sink;
  ResultReader reader(request, 1 << 20, sink);
  EXPECT_EQ(reader.AddPiece(Piece(0, 16)).code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(reader.AddSummary(GoodSummary()).code(), absl::StatusCode::kDataLoss);
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
    return reader.AddHeader(header).code() == absl::StatusCode::kDataLoss;
  };
  const auto grow = [](v1::ResultHeader& header, int64_t x) {
    header.mutable_grid()->mutable_dims()->set_x(x);
    header.mutable_arrays(0)->set_shape(2, uint64_t(x));
  };
  EXPECT_FALSE(refused([](auto&, auto&) {}));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.mutable_arrays(0)->set_shape(2, 5); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.mutable_arrays(0)->add_shape(2); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { *h.add_arrays() = h.arrays(0); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.clear_arrays(); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.clear_grid(); }));
  EXPECT_TRUE(refused([](auto&, auto& h) { h.set_layout(v1::LAYOUT_PLANAR); }));
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

}  // namespace
}  // namespace voxelpipe
