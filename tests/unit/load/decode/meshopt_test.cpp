// Streams are made with meshoptimizer's own encoder.
#include "load/decode/meshopt.h"

#include <meshoptimizer.h>

#include <cstring>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

std::vector<float> Positions(size_t count) {
  std::vector<float> p;
  for (size_t i = 0; i < count * 3; ++i) p.push_back(float(i % 17) * 0.25f);
  return p;
}

std::vector<uint8_t> EncodeVertices(const std::vector<float>& p) {
  const size_t count = p.size() / 3;
  std::vector<uint8_t> out(meshopt_encodeVertexBufferBound(count, 12));
  out.resize(meshopt_encodeVertexBuffer(out.data(), out.size(), p.data(), count, 12));
  return out;
}

MeshoptView View(uint64_t count, uint64_t stride, const char* mode, const char* filter = "NONE") {
  MeshoptView view;
  view.count = count;
  view.byte_stride = stride;
  view.mode = mode;
  view.filter = filter;
  return view;
}

TEST(MeshoptTest, Attributes) {
  const std::vector<float> p = Positions(100);
  const auto decoded = DecodeMeshopt(EncodeVertices(p), View(100, 12, "ATTRIBUTES"));
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  ASSERT_EQ(decoded->size(), p.size() * 4);
  EXPECT_EQ(std::memcmp(decoded->data(), p.data(), decoded->size()), 0);
}

TEST(MeshoptTest, TrianglesAndIndices) {
  std::vector<uint32_t> indices;
  for (uint32_t i = 0; i < 60; ++i) indices.insert(indices.end(), {i, i + 1, i + 2});
  std::vector<uint8_t> triangles(meshopt_encodeIndexBufferBound(indices.size(), 62));
  triangles.resize(meshopt_encodeIndexBuffer(triangles.data(), triangles.size(), indices.data(), indices.size()));
  const auto decoded = DecodeMeshopt(triangles, View(180, 2, "TRIANGLES"));
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(decoded->size(), 360u);

  std::vector<uint8_t> sequence(meshopt_encodeIndexSequenceBound(indices.size(), 62));
  sequence.resize(meshopt_encodeIndexSequence(sequence.data(), sequence.size(), indices.data(), indices.size()));
  const auto list = DecodeMeshopt(sequence, View(180, 4, "INDICES"));
  ASSERT_TRUE(list.ok()) << list.status();
  EXPECT_EQ(std::memcmp(list->data(), indices.data(), list->size()), 0);
}

TEST(MeshoptTest, RefusesWhatTheExtensionForbids) {
  const std::vector<uint8_t> stream = EncodeVertices(Positions(16));
  const auto code = [&](const MeshoptView& view) { return DecodeMeshopt(stream, view).status().code(); };
  using enum absl::StatusCode;
  EXPECT_EQ(code(View(16, 12, "POINTS")), kInvalidArgument);
  EXPECT_EQ(code(View(16, 10, "ATTRIBUTES")), kInvalidArgument);
  EXPECT_EQ(code(View(16, 260, "ATTRIBUTES")), kInvalidArgument);
  EXPECT_EQ(code(View(16, 0, "ATTRIBUTES")), kInvalidArgument);
  EXPECT_EQ(code(View(16, 3, "INDICES")), kInvalidArgument);
  EXPECT_EQ(code(View(16, 4, "TRIANGLES")), kInvalidArgument);  // not a multiple of 3
  EXPECT_EQ(code(View(16, 12, "ATTRIBUTES", "OCTAHEDRAL")), kInvalidArgument);
  EXPECT_EQ(code(View(16, 12, "ATTRIBUTES", "SQUARE")), kInvalidArgument);
  EXPECT_EQ(code(View(uint64_t{1} << 62, 12, "ATTRIBUTES")), kInvalidArgument);  // wraps in 64 bits
  EXPECT_EQ(code(View(3'000'000'000, 12, "ATTRIBUTES")), kInvalidArgument);
}

// Nothing packs better than equal vertices: that must pass, and a count just beyond what the codec can do must not.
TEST(MeshoptTest, TheBoundIsTheCodecsBestCase) {
  const size_t count = 1 << 16;
  std::vector<uint8_t> stream(meshopt_encodeVertexBufferBound(count, 16));
  const std::vector<uint8_t> equal(count * 16, 0);
  stream.resize(meshopt_encodeVertexBuffer(stream.data(), stream.size(), equal.data(), count, 16));
  const auto decoded = DecodeMeshopt(stream, View(count, 16, "ATTRIBUTES"));
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(*decoded, equal);
  const absl::Status s = DecodeMeshopt(stream, View(2 * count, 16, "ATTRIBUTES")).status();
  EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(s.message()).find("bytes can hold"), std::string::npos);
}

TEST(MeshoptTest, BrokenStreamsAreRefused) {
  std::vector<uint8_t> stream = EncodeVertices(Positions(16));
  for (size_t n = 0; n < stream.size(); ++n) {
    EXPECT_FALSE(DecodeMeshopt(std::span(stream).first(n), View(16, 12, "ATTRIBUTES")).ok()) << n;
  }
  stream[0] ^= 0xff;
  EXPECT_FALSE(DecodeMeshopt(stream, View(16, 12, "ATTRIBUTES")).ok());
}

}  // namespace
}  // namespace voxelpipe
